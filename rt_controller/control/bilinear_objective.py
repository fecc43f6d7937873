"""The objective of a model whose input matrix follows the lifted state: H is built every tick.

Frozen at psi_0, a bilinear model is a linear one with B_eff = B_uc + sum_r N_r diag(g_r), where
g_r = S_r psi_0 + s0_r. The condensed QP keeps its size: with the gains repeated over the stages,
Gamma_eff = Gamma_0 + sum_r Gamma_r diag(g_r), and
H = Gamma_eff' Q Gamma_eff + R + what changes of the inputs cost.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from rt_controller.contract.bilinear import Bilinear
from rt_controller.contract.bundle import Array, Bundle
from rt_controller.control.constraints import N_INPUTS
from rt_controller.control.cost import InputCost, OutputWeights
from rt_controller.control.objective import Situation, require_convex
from rt_controller.control.prediction import free_response, impulse_responses


class BilinearObjective:
    """Aimed by five small products, in memory allocated at start.

    Gamma_eff is block Toeplitz: its blocks are the impulse responses of B_eff, and those are the
    responses of B_uc and every N_r mixed by the gains. So the responses are mixed, not Gamma.

    Raises:
        ArtifactError: what the inputs cost by themselves does not make the problem convex.

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
    ) -> None:
        """`scale` (nv,) are the ranges of the inputs."""
        require_convex(inputs.H)  # then H is convex wherever the car is
        nv, m, p = scale.size, N_INPUTS, outputs.stage.size
        horizon = nv // m
        rows = horizon * p
        self._inputs = inputs
        # Outputs are counted in units in which each weighs one: H = effect effect' + R, … .
        self._units = np.sqrt(outputs.over(horizon))
        free = free_response(bundle, horizon, p)
        self._free_map = np.column_stack([free.Phi, free.lam, free.mu]) * self._units[:, None]

        # B_uc is one more direction, with a gain of one.
        directions = np.concatenate([bundle.B_uc[None], bilinear.N]) * scale[:m]
        responses = np.stack([impulse_responses(bundle.A, B, horizon, p) for B in directions])
        responses *= np.sqrt(outputs.stage)[:, None]
        self._responses = np.ascontiguousarray(responses.reshape(-1, rows, m).transpose(2, 0, 1))
        """(m, R + 1, N p)"""
        readout = np.concatenate([np.zeros((1, m, bundle.n_observables)), bilinear.S])
        offset = np.concatenate([np.ones((1, m)), bilinear.s0])
        self._readout = np.ascontiguousarray(readout.transpose(1, 0, 2)).reshape(offset.size, -1)
        self._offset = np.ascontiguousarray(offset.T).reshape(-1)

        self._gains = np.zeros(self._offset.size)
        """(m (R + 1),), of each input's directions, the constant one first"""
        self._mixture = self._gains.reshape(m, 1, -1)
        # The response to an input at stage j is that at stage 0, j stages later: a window that
        # begins j stages before the response, among zeros.
        padded = np.zeros((m, 1, 2 * rows))
        self._response = padded[:, :, rows:]
        windows = sliding_window_view(padded[:, 0], rows, axis=1)
        self._delayed = windows[:, rows:0:-p].transpose(1, 0, 2)
        """(N, m, N p), a view"""
        self._effect = np.zeros((nv, rows))
        """Gamma_eff' Q^(1/2)"""
        self._effect_by_stage = self._effect.reshape(horizon, m, rows)
        self._terminal_effect = self._effect[:, -p:]
        self._terminal_unit = np.sqrt(outputs.terminal_factor)
        self._wanted = np.zeros(rows)
        self._error = np.zeros(rows)
        self.H = np.zeros((nv, nv))
        self.gradient = np.zeros(nv)

    def aim(self, situation: Situation) -> None:
        np.dot(self._readout, situation.psi, out=self._gains)
        self._gains += self._offset
        np.matmul(self._mixture, self._responses, out=self._response)
        np.copyto(self._effect_by_stage, self._delayed)
        self._terminal_effect *= self._terminal_unit
        np.dot(self._effect, self._effect.T, out=self.H)
        self.H += self._inputs.H

        np.dot(self._free_map, situation.undriven, out=self._error)
        np.multiply(situation.reference.reshape(-1), self._units, out=self._wanted)
        self._error -= self._wanted
        np.dot(self._effect, self._error, out=self.gradient)
        self.gradient[:N_INPUTS] += self._inputs.from_previous * situation.previous
