"""A nonlinear MPC in the controller's place: it is driven, observed and asked as `Mpc` is."""

from typing import Protocol

import numpy as np

from benchmarks.peers.nonlinear.program import TRACKED, Moment, bounds_of
from rt_controller.contract.bundle import Array
from rt_controller.contract.limits import InputLimits
from rt_controller.contract.signals import ControlInput, PathReference, VehicleState
from rt_controller.control.constraints import N_INPUTS
from rt_controller.control.pedals import PedalChoice, lower_ceilings
from rt_controller.control.reference import ReferenceHorizon
from rt_controller.control.solver import SolveStatus


class Planning(Protocol):
    """Somebody who solves the nonlinear program."""

    def solve(self, moment: Moment, inputs: Array) -> bool:
        """Write the plan (N, 3) into `inputs`, in physical units; whether it can be used."""
        ...


class Nmpc:
    """References, pedals and limits as the controller has them; another model and solver."""

    iterations = 0
    solve_ns = 0

    def __init__(self, planning: Planning, horizon: int, limits: InputLimits) -> None:
        self._planning = planning
        self._bounds = bounds_of(limits)
        self._ceilings = np.tile(self._bounds.upper, (horizon, 1))
        self._reference = ReferenceHorizon(horizon)
        self._pedals = PedalChoice()
        self.inputs = np.zeros((horizon, N_INPUTS))

    def plan(
        self,
        state: VehicleState,
        curvature_per_m: float,
        path: PathReference,
        previous: ControlInput,
    ) -> SolveStatus:
        """As `Mpc.plan`."""
        reference = self._reference.expand(path, state, curvature_per_m)
        self._pedals.update(state.vx_mps - path.v_mps, path.a_mps2)
        start = np.array(previous) / self._bounds.span
        lower_ceilings(self._ceilings, self._pedals, start, self._bounds.slew)
        motion = np.array(state)[TRACKED]
        moment = Moment(motion, start, self._ceilings, reference[:, TRACKED], curvature_per_m)
        is_usable = self._planning.solve(moment, self.inputs)
        return SolveStatus.SOLVED if is_usable else SolveStatus.NUMERICS

    def prepare(self) -> None:
        """Nothing: all is done when the state is known."""

    def rehearse(self) -> None:
        """Nothing: it has no linear algebra to repeat that would not move its iterate."""

    def observe(self, state: VehicleState, held: ControlInput) -> None:
        """Nothing: it has no memory."""

    def forget(self) -> None:
        """Nothing, for the same reason."""

    def bound(self, budget_ns: int) -> None:
        """Nothing: its iterations are limited already."""
