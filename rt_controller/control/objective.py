"""Objective of the condensed QP, where the input matrix is constant and where it is not.

minimise 1/2 v' H v + f' v over v, the inputs of the horizon in units of their ranges.
"""

import numpy as np
from numpy.lib.stride_tricks import as_strided

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.model.bilinear import Bilinear
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.drift import Drift, no_drift
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
    whose input matrix changes with the stage: B_eff,j = B_uc + sum_r N_r diag(g_r,j), with the
    gains g_r,j of `Bilinear`. The condensed QP keeps its size: column j of Gamma_eff is column j of
    Gamma_0 + sum_r Gamma_r diag(g_r,j), and H = Gamma_eff' Q Gamma_eff + R + the cost of changes of
    the inputs. A linear model is one without gains. The drift along the same states is a constant
    of each stage, like the offset c.

    The states are those that the nominal inputs (the last plan, shifted) lead to. One QP a period
    is one iteration of a sequence that would solve the nonlinear problem (quasi-linear MPC;
    Cisneros and Werner, 2020).

    The response to an input at stage j is the response to that input at stage 0, j stages later.
    So only the impulse responses of B_uc and of every N_r are stored; each stage is their sum
    weighted by the gains of that stage. The size of Gamma does not depend on the number of latents.

    Raises:
        ArtifactError: H changes, and the cost of the inputs alone is not strictly convex.

    Paper: eq. (14), with the bilinear model that its conclusion names.
    """

    def __init__(self, bundle: Bundle, cost: CostTerms) -> None:
        nv, m, p, horizon = cost.scale.size, N_INPUTS, cost.stage.size, cost.horizon
        n, rows = bundle.n_observables, horizon * p
        self.hessian_varies = bundle.bilinear is not None or bundle.drift is not None
        bilinear = bundle.bilinear or Bilinear(
            np.zeros((0, n, m)), np.zeros((0, m, n)), np.zeros((0, m))
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
        self._gains = GainsAlongPlan(bundle, bilinear, horizon)
        self._drift = bundle.drift and DriftResponse(bundle.A, bundle.drift, horizon, sqrt_q)
        self._offset = self._free_response_map[:, n + 1].copy()
        """(N p,), the response to c"""
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

    @property
    def ey_drift(self) -> Array | None:
        """(N,), what the drift adds to e_y at stages 1 … N, in metres; None: there is none."""
        return None if self._drift is None else self._drift.ey_m

    def update_matrices(self, parameters: QpParameters) -> None:
        """Update H, and the maps of the gradient, around the parameters and nominal inputs."""
        self._gains.update(parameters.initial, parameters.nominal_inputs)
        if self._drift is not None:
            self._drift.update(self._gains.drift_terms)
            np.add(self._offset, self._drift.outputs, out=self._free_response_map[:, -1])
        np.matmul(self._gains.by_stage, self._responses, out=self._response)
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


class DriftResponse:
    """What the drift along the nominal inputs adds to the outputs."""

    def __init__(self, A: Array, drift: Drift, horizon: int, sqrt_q: Array) -> None:
        p, D = sqrt_q.size // horizon, drift.rank
        responses = impulse_responses(A, drift.N, horizon, p)
        delayed = np.zeros((horizon, p, horizon, D))
        for j in range(horizon):
            delayed[j:, :, j] = responses[: horizon - j]
        self._map = delayed.reshape(horizon * p, -1) * sqrt_q[:, None]
        """(N p, N D)"""
        self._ey_map = np.ascontiguousarray(delayed[:, StateColumn.ey_m].reshape(horizon, -1))
        self.outputs = np.zeros(horizon * p)
        """(N p,), in units in which each has weight one"""
        self.ey_m = np.zeros(horizon)
        """(N,)"""

    def update(self, terms: Array) -> None:
        """Compute `outputs` and `ey_m` of the terms (N, D) at each stage."""
        np.dot(self._map, terms.reshape(-1), out=self.outputs)
        np.dot(self._ey_map, terms.reshape(-1), out=self.ey_m)


class GainsAlongPlan:
    """Gains of the inputs, and terms of the drift, along nominal inputs.

    Both are functions of a_j = S psi_j + s0, which is a_j of the free response plus the sum over
    i < j of K_(j-1-i) [u_i; g_i u_i; t_i] with K_d = S A^d [B_uc, N_1, …, N_R, N of the drift]:
    a recursion in the few a_j instead of all observables.
    """

    def __init__(self, bundle: Bundle, bilinear: Bilinear, horizon: int) -> None:
        n, m, R = bundle.n_observables, N_INPUTS, bilinear.rank
        drift = bundle.drift or no_drift(n)
        self._saturates = bilinear.saturates
        self._is_recursive = bilinear.follows is Follow.PREDICTION
        self._gain_map = _gain_map(bundle, bilinear, horizon)
        """(m N (R + 1), n + 2)"""
        self._gains = np.zeros(len(self._gain_map))
        self.by_stage = self._gains.reshape(m, horizon, R + 1)
        """(m, N, R + 1), of each input at each stage, the constant direction first"""
        self._varying = self.by_stage[:, :, 1:]
        self._drift = drift
        self._has_drift = drift.rank > 0
        self._is_saturation = drift.is_saturation.astype(np.float64)
        self._drift_map = _drift_map(bundle, drift, bilinear.follows, horizon)
        """(N D, n + 2)"""
        self.drift_terms = np.zeros((horizon, drift.rank))
        """(N, D)"""
        self._n_gains = m * R
        columns = np.concatenate([bundle.B_uc[None], bilinear.N]).transpose(1, 2, 0).reshape(n, -1)
        self._K = _responses_of(
            np.concatenate([bilinear.S.transpose(1, 0, 2).reshape(-1, n), drift.S]),
            bundle.A,
            np.concatenate([columns, drift.N], axis=1),
            horizon - 1,
        )
        """((N - 1) (m R + D), m (R + 1) + D)"""
        self._forced = np.zeros((horizon, m * R + drift.rank))
        """(N, m R + D), what the stages before add to a_j of each"""
        self._addition = np.zeros(len(self._K))
        self._action = np.zeros(m * (R + 1) + drift.rank)
        self._action_of_inputs = self._action[: m * (R + 1)].reshape(m, R + 1)
        self._action_of_drift = self._action[m * (R + 1) :]

    def update(self, initial: Array, inputs: Array) -> None:
        """Compute `by_stage` and `drift_terms` from [psi_0; kappa; 1] along `inputs` (N, m)."""
        np.dot(self._gain_map, initial, out=self._gains)
        if self._has_drift:
            np.dot(self._drift_map, initial, out=self.drift_terms.reshape(-1))
        factors = self._drift.factors(initial[-2:-1])
        if self._is_recursive:
            self._add_forced_response(inputs, factors)
            return
        if self._saturates:
            np.tanh(self._varying, out=self._varying)
        if self._has_drift:
            a = self.drift_terms
            a[:] = np.tanh(a) * factors - a * self._is_saturation

    def _add_forced_response(self, inputs: Array, drift_factors: Array) -> None:
        forced, width, n_gains = self._forced, self._forced.shape[1], self._n_gains
        forced[:] = 0.0
        for stage, u in enumerate(inputs):
            gains = self._varying[:, stage]
            gains += forced[stage, :n_gains].reshape(gains.shape)
            if self._saturates:
                np.tanh(gains, out=gains)
            if self._has_drift:
                a, terms = self.drift_terms[stage], self._action_of_drift
                a += forced[stage, n_gains:]
                np.tanh(a, out=terms)
                terms *= drift_factors
                terms -= np.multiply(a, self._is_saturation, out=a)
                a[:] = terms
            rows = len(self._K) - stage * width
            if rows == 0:
                return
            self._action_of_inputs[:, 0] = u
            np.multiply(gains, u[:, None], out=self._action_of_inputs[:, 1:])
            addition = self._addition[:rows]
            np.dot(self._K[:rows], self._action, out=addition)
            forced[stage + 1 :] += addition.reshape(-1, width)


def _responses_of(S: Array, A: Array, columns: Array, steps: int) -> Array:
    """S A^d columns for d = 0 … steps - 1, one below the other."""
    responses = np.zeros((steps, len(S), columns.shape[1]))
    for d in range(steps):
        responses[d] = S @ columns
        columns = A @ columns
    return responses.reshape(steps * len(S), columns.shape[1])


def _gain_map(bundle: Bundle, bilinear: Bilinear, horizon: int) -> Array:
    """Map from [psi_0; kappa; 1] to S psi_j + s0 (m, N, R + 1), flat, of the free response.

    The first of the R + 1 is the constant 1.
    """
    S, s0, follows = bilinear.S, bilinear.s0, bilinear.follows
    varying = _along_free_response(bundle, S, s0, follows, horizon)  # (N, R, m, n + 2)
    constant = np.zeros((horizon, 1, *varying.shape[2:]))
    constant[..., -1] = 1.0
    gains = np.concatenate([constant, varying], axis=1).transpose(2, 0, 1, 3)
    return np.ascontiguousarray(gains.reshape(-1, gains.shape[-1]))


def _drift_map(bundle: Bundle, drift: Drift, follows: Follow, horizon: int) -> Array:
    """Map from [psi_0; kappa; 1] to S psi_j + s0 (N, D), flat, of the free response."""
    varying = _along_free_response(bundle, drift.S, drift.s0, follows, horizon)
    return np.ascontiguousarray(varying.reshape(-1, varying.shape[-1]))


def _along_free_response(
    bundle: Bundle, S: Array, s0: Array, follows: Follow, horizon: int
) -> Array:
    """Maps (N, ..., n + 2) from [psi_0; kappa; 1] to S psi_j + s0 for j = 0 … N - 1; S (..., n).

    psi_j is psi_0 for all j if that is what the gains follow.
    """
    n, stages = bundle.n_observables, 1 if follows is Follow.START else horizon
    later = free_response(bundle, stages - 1, n).reshape(stages - 1, n, n + 2)
    psi = np.concatenate([np.eye(n, n + 2)[None], later])  # (N, n, n + 2)
    varying: Array = np.tensordot(S, psi, axes=(-1, 1))
    varying = np.moveaxis(varying, -2, 0)
    varying[..., -1] += s0
    return np.broadcast_to(varying, (horizon, *varying.shape[1:]))
