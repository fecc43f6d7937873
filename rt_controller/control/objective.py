"""Objective of the condensed QP, where the input matrix is constant and where it is not.

minimise 1/2 v' H v + f' v over v, the inputs of the horizon in units of their ranges.
"""

import numpy as np
from numpy.lib.stride_tricks import as_strided

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.model.bilinear import Bilinear
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.follow import Follow
from rt_controller.contract.schema import N_INPUTS
from rt_controller.contract.signals import StateColumn
from rt_controller.control.program import QpParameters
from rt_controller.control.terms import CostTerms


def free_response(bundle: Bundle, horizon: int, n_outputs: int) -> Array:
    """Map (N p, n + 2) from [psi_0; kappa; 1] to the outputs of stages 1 … N without inputs.

    The outputs are the first p = `n_outputs` observables. Curvature is constant over the horizon,
    as in the paper.

    Paper: eq. (14), its equality constraints.
    """
    n = bundle.n_observables
    response = np.zeros((horizon, n_outputs, n + 2))
    # psi_k = S psi_0 + w kappa + d, one recursion in k.
    S, w, d = np.eye(n), np.zeros(n), np.zeros(n)
    for k in range(horizon):
        S = bundle.A @ S
        w = bundle.A @ w + bundle.B_uw[:, 0]
        d = bundle.A @ d + bundle.c
        response[k] = np.column_stack([S, w, d])[:n_outputs]
    return response.reshape(horizon * n_outputs, n + 2)


def impulse_responses(A: Array, B: Array, horizon: int, n_outputs: int) -> Array:
    """Outputs (N, p, m) of stages 1 … N after one unit of each input at stage 0; B is (n, m)."""
    responses = np.zeros((horizon, n_outputs, B.shape[1]))
    psi = B
    for k in range(horizon):
        responses[k] = psi[:n_outputs]
        psi = A @ psi
    return responses


def require_convex(H: Array) -> None:
    """Return if H is positive definite.

    Raises:
        ArtifactError: H is not positive definite.
    """
    smallest = float(np.linalg.eigvalsh(H)[0])
    if smallest <= 0.0:
        raise ArtifactError(
            f"The QP is not strictly convex: expected a positive smallest eigenvalue of its "
            f"Hessian, found {smallest:.3g}. Give every input a finite tolerance of change in "
            f"`mpc.tolerance`."
        )


class Objective:
    """The objective, computed in preallocated memory: H (nv, nv) and the gradient f (nv,).

    A bilinear model has a new H every period. Along given lifted states psi_j it is a linear one
    whose input matrix changes with the stage: B_eff,j = B_uc + sum_r N_r diag(g_r,j), where
    g_r,j = S_r psi_j + s0_r. The condensed QP keeps its size: column j of Gamma_eff is column j of
    Gamma_0 + sum_r Gamma_r diag(g_r,j), and H = Gamma_eff' Q Gamma_eff + R + the cost of changes of
    the inputs. A linear model is one without gains.

    The states are those that the nominal inputs (the last plan, shifted) lead to. One QP a period
    is one iteration of a sequence that would solve the bilinear problem (quasi-linear MPC; Cisneros
    and Werner, 2020).

    The response to an input at stage j is the response to that input at stage 0, j stages later.
    So only the impulse responses of B_uc and of every N_r are stored; each stage is their sum
    weighted by the gains of that stage. The size of Gamma does not depend on the number of latents.

    Raises:
        ArtifactError: the model is bilinear, and the cost of the inputs alone not strictly convex.

    Paper: eq. (14), with the bilinear model that its conclusion names.
    """

    def __init__(self, bundle: Bundle, cost: CostTerms) -> None:
        nv, m, p, horizon = cost.scale.size, N_INPUTS, cost.stage.size, cost.horizon
        n, rows = bundle.n_observables, horizon * p
        self.hessian_varies = bundle.bilinear is not None
        bilinear = bundle.bilinear or Bilinear(
            np.zeros((0, n, m)), np.zeros((0, m, n)), np.zeros((0, m)), Follow.START
        )
        if self.hessian_varies:
            require_convex(cost.H)  # then H is convex for every state
        self._H_inputs = cost.H
        # Outputs are counted in units in which each has weight one: H = gamma_q gamma_q' + R.
        sqrt_q = np.sqrt(cost.output_weights())
        self._free_response_map = free_response(bundle, horizon, p) * sqrt_q[:, None]
        """(N p, n + 2)"""

        # B_uc is one more direction, with a gain of one.
        directions = np.concatenate([bundle.B_uc[None], bilinear.N]) * cost.scale[:m]
        responses = np.stack([impulse_responses(bundle.A, B, horizon, p) for B in directions])
        self._responses = np.ascontiguousarray(responses.reshape(-1, rows, m).transpose(2, 0, 1))
        """(m, R + 1, N p)"""
        self._gain_map = _gain_map(bundle, bilinear, horizon)
        """(m N (R + 1), n + 2)"""
        self._gains = np.zeros(len(self._gain_map))
        self._gains_by_stage = self._gains.reshape(m, horizon, -1)
        """(m, N, R + 1), of each input at each stage, the constant direction first"""
        self._feedback = (
            GainFeedback(bundle, bilinear, horizon)
            if bilinear.follows is Follow.PREDICTION
            else None
        )
        padded = np.zeros((m, horizon, 2 * rows))
        self._response = padded[:, :, rows:]
        """(m, N, N p), as if every stage were the first"""
        of_input, of_stage, of_row = self._response.strides
        self._delayed_response = as_strided(
            self._response, (horizon, m, rows), (of_stage - p * of_row, of_input, of_row)
        )
        """(N, m, N p), Gamma_eff', a view that begins j stages earlier, in the zeros"""
        self._gamma_q = np.zeros((nv, rows))
        """Gamma_eff' Q^(1/2)"""
        self._gamma_q_by_stage = self._gamma_q.reshape(horizon, m, rows)
        self._sqrt_q = np.tile(sqrt_q, (nv, 1))
        """as large as gamma_q: numpy would allocate memory for a product with one row"""
        self._minus_sqrt_q = -self._sqrt_q
        self._gradient_map = np.zeros((nv, n + 2 + m + rows))
        """of `QpParameters.vector`"""
        self._map_of_initial = self._gradient_map[:, : n + 2]
        np.fill_diagonal(self._gradient_map[:, n + 2 : n + 2 + m], cost.from_previous)
        self._map_of_reference = self._gradient_map[:, n + 2 + m :]
        self._product = np.zeros((nv, n + 2))
        self.ey_response = np.zeros((horizon, nv))
        """(N, nv), what the inputs add to e_y at stages 1 … N, in metres"""
        self._ey_response_by_stage = self.ey_response.reshape(horizon, horizon, m)
        self._delayed_ey_response = self._delayed_response[:, :, StateColumn.ey_m :: p]
        self.H = np.zeros((nv, nv))
        self.gradient = np.zeros(nv)

    def update_matrices(self, parameters: QpParameters) -> None:
        """Update H, and the maps of the gradient, around the parameters and nominal inputs."""
        np.dot(self._gain_map, parameters.initial, out=self._gains)
        if self._feedback is not None:
            self._feedback.add(self._gains_by_stage[:, :, 1:], parameters.nominal_inputs)
        np.matmul(self._gains_by_stage, self._responses, out=self._response)
        np.copyto(self._gamma_q_by_stage, self._delayed_response)
        self._gamma_q *= self._sqrt_q
        np.dot(self._gamma_q, self._gamma_q.T, out=self.H)
        self.H += self._H_inputs
        np.dot(self._gamma_q, self._free_response_map, out=self._product)
        np.copyto(self._map_of_initial, self._product)
        self._gamma_q *= self._minus_sqrt_q  # from here on -Gamma_eff' Q
        np.copyto(self._map_of_reference, self._gamma_q)
        np.copyto(self._ey_response_by_stage, self._delayed_ey_response.transpose(2, 0, 1))

    def update_vectors(self, parameters: QpParameters) -> None:
        """Update the gradient, with the maps of the last `update_matrices`."""
        np.dot(self._gradient_map, parameters.vector, out=self.gradient)


class GainFeedback:
    """Change of the gains of later stages by the inputs, which act by the gains of their stages.

    g_j = its free response + sum over i < j of K_(j-1-i) [u_i; g_i u_i], with
    K_d = S A^d [B_uc, N_1, …, N_R]: a recursion in the few gains instead of all observables.
    """

    def __init__(self, bundle: Bundle, bilinear: Bilinear, horizon: int) -> None:
        rank, m, n = bilinear.S.shape
        self._m = m
        columns = np.concatenate([bundle.B_uc[None], bilinear.N]).transpose(1, 2, 0)
        psi, steps = columns.reshape(n, -1), []  # (n, m (R + 1)), input by input
        S = bilinear.S.transpose(1, 0, 2).reshape(-1, n)  # (m R, n)
        for _ in range(horizon - 1):
            steps.append(S @ psi)
            psi = bundle.A @ psi
        self._K = np.ascontiguousarray(np.reshape(steps, (-1, m * (rank + 1))))
        """((N - 1) m R, m (R + 1))"""
        self._forced = np.zeros((horizon, m * rank))
        """(N, m R), what the stages before add to the gains of each"""
        self._addition = np.zeros(len(self._K))
        self._action = np.zeros((m, rank + 1))

    def add(self, gains: Array, inputs: Array) -> None:
        """Turn gains (m, N, R) of the free response into those along `inputs` (N, m), in place."""
        forced, action, width = self._forced, self._action, self._forced.shape[1]
        forced[:] = 0.0
        for stage, u in enumerate(inputs):
            gains[:, stage] += forced[stage].reshape(self._m, -1)
            rows = len(self._K) - stage * width
            if rows == 0:
                return
            action[:, 0] = u
            np.multiply(gains[:, stage], u[:, None], out=action[:, 1:])
            addition = self._addition[:rows]
            np.dot(self._K[:rows], action.reshape(-1), out=addition)
            forced[stage + 1 :] += addition.reshape(-1, width)


def _gain_map(bundle: Bundle, bilinear: Bilinear, horizon: int) -> Array:
    """Map from [psi_0; kappa; 1] to the gains (m, N, R + 1), flat, of the free response."""
    n, m = bundle.n_observables, N_INPUTS
    stages = 0 if bilinear.follows is Follow.START else horizon - 1
    later = free_response(bundle, stages, n).reshape(stages, n, n + 2)
    psi = np.concatenate([np.eye(n, n + 2)[None], later])  # (stages + 1, n, n + 2)
    varying = np.einsum("rin,jnc->ijrc", bilinear.S, psi)
    varying[..., -1] += bilinear.s0.T[:, None, :]
    constant = np.zeros((m, len(psi), 1, n + 2))
    constant[..., -1] = 1.0
    gains = np.concatenate([constant, varying], axis=2)
    return np.ascontiguousarray(
        np.broadcast_to(gains, (m, horizon, *gains.shape[2:])).reshape(-1, n + 2)
    )
