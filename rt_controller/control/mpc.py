"""The model predictive controller: a lifted state and a reference in, a plan of inputs out."""

import numpy as np

from rt_controller.contract.artifact import N_STATES, Bundle
from rt_controller.contract.limits import InputLimits
from rt_controller.contract.signals import ControlInput, PathReference, VehicleState
from rt_controller.control.cost import TrackingCost
from rt_controller.control.lift import Encoder
from rt_controller.control.pedals import PedalChoice, lower_ceilings
from rt_controller.control.qp import N_INPUTS, assemble
from rt_controller.control.reference import ReferenceHorizon
from rt_controller.control.solver import PiqpWorkspace, SolveStatus


class Mpc:
    """Eq. (14) with one bundle's model, everything allocated at start.

    Raises:
        ArtifactError: the bundle cannot be lifted with or planned with.

    Paper: eq. (14).
    """

    def __init__(
        self, bundle: Bundle, horizon: int, cost: TrackingCost, limits: InputLimits
    ) -> None:
        self._encoder = Encoder(bundle)
        self._qp = assemble(bundle, horizon, cost, limits)
        self._workspace = PiqpWorkspace(self._qp)
        self._reference = ReferenceHorizon(horizon)
        self._pedals = PedalChoice()
        qp, n = self._qp, bundle.n_observables
        self._tracks_latents = qp.n_outputs > N_STATES
        self._operand = np.zeros(qp.gradient_map.shape[1])
        self._operand[n + 1] = 1.0
        self._psi = self._operand[:n]
        self._previous = self._operand[n + 2 : n + 2 + N_INPUTS]
        self._outputs = self._operand[n + 2 + N_INPUTS :].reshape(horizon, qp.n_outputs)
        self._gradient = np.zeros(qp.scale.size)
        self._slew_lower = -qp.slew
        self._slew_upper = qp.slew.copy()
        self._upper = qp.upper.copy()
        self._ceilings = self._upper.reshape(horizon, N_INPUTS)
        self.inputs = np.zeros((horizon, N_INPUTS))
        """(N, 3), the plan of the last solve that succeeded"""

    @property
    def iterations(self) -> int:
        """Iterations of the last solve."""
        return self._workspace.iterations

    @property
    def solve_ns(self) -> int:
        """Time of the last solve, vectors in to solution out."""
        return self._workspace.solve_ns

    def plan(
        self,
        state: VehicleState,
        curvature_per_m: float,
        path: PathReference,
        previous: ControlInput,
    ) -> SolveStatus:
        """How planning from here ended; on SOLVED, `inputs` holds the plan.

        `previous` is the input of the last period: slew rates and the cost of change start there.
        """
        self._psi[:] = self._encoder.lift(state)
        self._operand[self._psi.size] = curvature_per_m
        self._previous[:] = previous
        reference = self._reference.expand(path, state, curvature_per_m)
        self._outputs[:] = (
            self._encoder.lift_batch(reference) if self._tracks_latents else reference
        )
        np.dot(self._qp.gradient_map, self._operand, out=self._gradient)
        self._pedals.update(state.vx_mps - path.v_mps, path.a_mps2)
        self._bound(previous)

        status = self._workspace.solve(
            self._gradient, self._slew_lower, self._slew_upper, self._upper
        )
        if status is SolveStatus.SOLVED:
            np.multiply(self._workspace.solution, self._qp.scale, out=self.inputs.reshape(-1))
        return status

    def _bound(self, previous: ControlInput) -> None:
        qp = self._qp
        start = np.array(previous) / qp.scale[:N_INPUTS]
        slew = qp.slew[:N_INPUTS]
        self._slew_lower[:N_INPUTS] = start - slew
        self._slew_upper[:N_INPUTS] = start + slew
        lower_ceilings(self._ceilings, self._pedals, start, slew)
