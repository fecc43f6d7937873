"""The objective of a model whose input matrix follows the lifted state: H is built for every tick.

Along given lifted states psi_j a bilinear model is a linear one whose input matrix changes with
the stage: B_eff,j = B_uc + sum_r N_r diag(g_r,j), where g_r,j = S_r psi_j + s0_r. The condensed QP
keeps its size: column j of Gamma_eff is column j of Gamma_0 + sum_r Gamma_r diag(g_r,j), and
H = Gamma_eff' Q Gamma_eff + R + what changes of the inputs cost.

The states are those that the last plan leads to. A plan that is repeated predicts itself as the
model does, and from tick to tick plans change little: one QP a tick is one iteration of a sequence
that would solve the bilinear problem (quasi-linear MPC; Cisneros and Werner, 2020).
"""

import numpy as np
from numpy.lib.stride_tricks import as_strided

from rt_controller.contract.bilinear import Bilinear
from rt_controller.contract.bundle import Array, Bundle
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.follow import Follow
from rt_controller.control.constraints import N_INPUTS
from rt_controller.control.cost import InputCost, OutputWeights
from rt_controller.control.objective import LATERAL, Situation, require_convex
from rt_controller.control.prediction import free_response, impulse_responses


class BilinearObjective:
    """Prepared by some small products and aimed by two, in memory allocated at start.

    What an input at stage j does is what it would do at stage 0, j stages later, so only the
    impulse responses of B_uc and every N_r are kept; each stage mixes them by its gains.

    Raises:
        ArtifactError: what the inputs cost by themselves does not make the problem convex.
        ConfigError: e_y is watched and has no weight.

    Paper: eq. (14), with the bilinear model that its conclusion names.
    """

    renews_hessian = True

    def __init__(
        self,
        bundle: Bundle,
        bilinear: Bilinear,
        outputs: OutputWeights,
        scale: Array,
        inputs: InputCost,
        watches_lateral: bool = False,
    ) -> None:
        """`scale` (nv,) are the ranges of the inputs; `lateral` is kept up to date if watched."""
        require_convex(inputs.H)  # then H is convex wherever the car is
        nv, m, p = scale.size, N_INPUTS, outputs.stage.size
        horizon = nv // m
        rows = horizon * p
        self._inputs = inputs
        # Outputs are counted in units in which each weighs one: H = effect effect' + R, … .
        self._units = np.sqrt(outputs.over(horizon))
        free = free_response(bundle, horizon, p)
        self._free_map = np.column_stack([free.Phi, free.lam, free.mu]) * self._units[:, None]
        """(N p, n + 2)"""

        # B_uc is one more direction, with a gain of one.
        directions = np.concatenate([bundle.B_uc[None], bilinear.N]) * scale[:m]
        responses = np.stack([impulse_responses(bundle.A, B, horizon, p) for B in directions])
        responses *= np.sqrt(outputs.stage)[:, None]
        self._responses = np.ascontiguousarray(responses.reshape(-1, rows, m).transpose(2, 0, 1))
        """(m, R + 1, N p)"""
        self._gain_map = _gain_map(bundle, bilinear, horizon)
        """(m N (R + 1), n + 2)"""
        self._gains = np.zeros(len(self._gain_map))
        self._mixture = self._gains.reshape(m, horizon, -1)
        """(m, N, R + 1), of each input's directions at each stage, the constant one first"""
        self._feedback = (
            GainFeedback(bundle, bilinear, horizon)
            if bilinear.follows is Follow.PREDICTION
            else None
        )
        padded = np.zeros((m, horizon, 2 * rows))
        self._response = padded[:, :, rows:]
        """(m, N, N p), as if every stage were the first"""
        of_input, of_stage, of_row = self._response.strides
        self._delayed = as_strided(
            self._response, (horizon, m, rows), (of_stage - p * of_row, of_input, of_row)
        )
        """(N, m, N p), a view that begins j stages earlier, among the zeros"""
        self._effect = np.zeros((nv, rows))
        """Gamma_eff' Q^(1/2)"""
        self._effect_by_stage = self._effect.reshape(horizon, m, rows)
        self._terminal_effect = self._effect[:, -p:]
        self._terminal_unit = np.sqrt(outputs.terminal_factor)
        undriven = self._free_map.shape[1]
        self._of_past = np.zeros((nv, undriven + m))
        """of [psi_0; kappa; 1; u_prev]"""
        np.fill_diagonal(self._of_past[:, undriven:], inputs.from_previous)
        self._of_undriven = self._of_past[:, :undriven]
        self._product = np.zeros((nv, undriven))
        self._wanted = np.zeros(rows)
        self._pull = np.zeros(nv)
        if watches_lateral and self._units[LATERAL] == 0.0:
            raise ConfigError(
                "--mpc.corridor-m with a bilinear model: expected a finite --mpc.tolerance.ey-m, "
                "found inf. Give e_y a tolerance, however large."
            )
        self._watches_lateral = watches_lateral
        self._lateral_effect = self._effect[:, LATERAL::p].T
        self._lateral_units = self._units[LATERAL::p, None]
        self.lateral = np.zeros((horizon, nv))
        self.H = np.zeros((nv, nv))
        self.gradient = np.zeros(nv)

    def prepare(self, situation: Situation) -> None:
        np.dot(self._gain_map, situation.undriven, out=self._gains)
        if self._feedback is not None:
            self._feedback.add(self._mixture[:, :, 1:], situation.expected)
        np.matmul(self._mixture, self._responses, out=self._response)
        np.copyto(self._effect_by_stage, self._delayed)
        self._terminal_effect *= self._terminal_unit
        np.dot(self._effect, self._effect.T, out=self.H)
        self.H += self._inputs.H
        np.dot(self._effect, self._free_map, out=self._product)
        np.copyto(self._of_undriven, self._product)

        if self._watches_lateral:
            np.divide(self._lateral_effect, self._lateral_units, out=self.lateral)

    def aim(self, situation: Situation) -> None:
        np.dot(self._of_past, situation.past, out=self.gradient)
        np.multiply(situation.reference.reshape(-1), self._units, out=self._wanted)
        np.dot(self._effect, self._wanted, out=self._pull)
        self.gradient -= self._pull


class GainFeedback:
    """What inputs do to the gains of later stages, themselves acting by the gains of theirs.

    g_j = its free response + sum over i < j of K_(j-1-i) [u_i; g_i u_i], with
    K_d = S A^d [B_uc, N_1, …, N_R]: a recursion in the few gains instead of all observables.
    """

    def __init__(self, bundle: Bundle, bilinear: Bilinear, horizon: int) -> None:
        rank, m, n = bilinear.S.shape
        self._m = m
        columns = np.concatenate([bundle.B_uc[None], bilinear.N]).transpose(1, 2, 0)
        arrived, steps = columns.reshape(n, -1), []  # (n, m (R + 1)), input by input
        read = bilinear.S.transpose(1, 0, 2).reshape(-1, n)  # (m R, n)
        for _ in range(horizon - 1):
            steps.append(read @ arrived)
            arrived = bundle.A @ arrived
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
    """What makes gains (m, N, R + 1), flat, of [psi_0; kappa; 1]."""
    n, m = bundle.n_observables, N_INPUTS
    stages = 0 if bilinear.follows is Follow.START else horizon - 1
    free = free_response(bundle, stages, n)
    later = np.column_stack([free.Phi, free.lam, free.mu]).reshape(stages, n, n + 2)
    psi = np.concatenate([np.eye(n, n + 2)[None], later])  # (stages + 1, n, n + 2)
    read = np.einsum("rin,jnc->ijrc", bilinear.S, psi)
    read[..., -1] += bilinear.s0.T[:, None, :]
    constant = np.zeros((m, len(psi), 1, n + 2))
    constant[..., -1] = 1.0
    gains = np.concatenate([constant, read], axis=2)
    return np.ascontiguousarray(
        np.broadcast_to(gains, (m, horizon, *gains.shape[2:])).reshape(-1, n + 2)
    )
