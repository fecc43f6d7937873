"""The input of a tick: by the model, by the low-speed law, or from the last good plan."""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import (
    ControlInput,
    CurvaturePreview,
    Mode,
    PathReference,
    VehicleState,
)
from rt_controller.control.low_speed import LowSpeedLaw
from rt_controller.control.planner import Planner
from rt_controller.control.program import SolveStatus


class PlannedInput(NamedTuple):
    """What is planned for a tick."""

    control: ControlInput | None
    """the plan's input for this tick: of a new plan, else of the last good one; None: none left"""
    has_solver_failed: bool = False
    qp_iterations: int = 0
    qp_ns: int = 0
    lifted: Array | None = None
    """the state as the model lifts it; None: the model did not plan"""


class InputPlanner:
    """The planner, the law below its speeds, and the memory of both."""

    def __init__(self, planner: Planner, low_speed: LowSpeedLaw) -> None:
        self._planner = planner
        self._low_speed = low_speed
        self._inputs = np.zeros_like(planner.inputs)
        """(N, 3), the last good plan"""
        self.periods_held = len(planner.inputs)
        """periods since that plan was made; at least N if there was none yet"""

    @property
    def law(self) -> Mode:
        """That of the last plan: NOMINAL, LOW_SPEED or STANDSTILL."""
        return self._low_speed.law

    def most_steer_rad(self, vx_mps: float) -> float:
        """Bound of the wheel at this speed by the law that drives."""
        if self.law is Mode.NOMINAL:
            return self._low_speed.largest_plan_rad(vx_mps)
        return self._low_speed.largest_wheel_rad(vx_mps)

    def hold(self, periods: int) -> PlannedInput:
        """The input of the last plan, `periods` after the last one; no control after its end."""
        return PlannedInput(self._input_after(periods))

    def _input_after(self, periods: int) -> ControlInput | None:
        self.periods_held += periods
        if self.periods_held >= len(self._inputs):
            return None
        return ControlInput(*self._inputs[self.periods_held].tolist())

    def plan(
        self,
        x_0: VehicleState,
        curvature_per_m: float,
        path: PathReference,
        preview: CurvaturePreview | None,
        last: ControlInput,
        periods: int,
        *,
        stops: bool,
        under_way: Sequence[ControlInput] = (),
        steering_rate_radps: float = inf,
        of_car: ControlInput | None = None,
    ) -> PlannedInput:
        """Lift the state, expand the reference, solve; or low-speed law; or hold the last plan.

        Args:
            x_0: of `observe` in this tick.
            curvature_per_m: of the road at the car.
            path: to follow, as seen from the car.
            preview: curvature of the road ahead; None: constant.
            last: input of the last tick, `periods` ago.
            periods: since the last tick.
            stops: the car is to be brought to rest, whatever speed the path says.
            under_way: inputs that were sent and act, one a period, before the one of this tick.
            steering_rate_radps: largest rate of the wheel, if it is below that of the commands.
            of_car: input of the driver who still drives the car; None: the controller drives.
        """
        previous_law = self._low_speed.law
        slow_path = path._replace(v_mps=0.0, a_mps2=0.0) if stops else path
        if self._low_speed.choose(x_0.vx_mps, slow_path, last.steer_rad) is not Mode.NOMINAL:
            slow = self._low_speed.control(
                x_0, curvature_per_m, slow_path, last, under_way, preview
            )
            self._inputs[:], self.periods_held = slow, 0
            return PlannedInput(slow)
        if previous_law is not Mode.NOMINAL:
            self._planner.resume(last)
        if of_car is not None:
            self._planner.observer.assume_steady(x_0, curvature_per_m, of_car)
        if steering_rate_radps < inf and under_way:
            last = last._replace(steer_rad=under_way[-1].steer_rad)
        # A wheel that was turned further at a lower speed returns with its rate.
        most_rad = max(self._low_speed.most_plan_rad, abs(last.steer_rad))
        self._planner.limit_steering(most_rad, steering_rate_radps)
        status = self._planner.plan(x_0, curvature_per_m, path, last, preview, under_way)
        is_solved = status is SolveStatus.SOLVED
        if is_solved:
            self._inputs[:], self.periods_held = self._planner.inputs, 0
        control = self._input_after(0 if is_solved else periods)
        planner = self._planner
        psi = planner.observer.psi
        return PlannedInput(control, not is_solved, planner.iterations, planner.solve_ns, psi)

    def prepare(self) -> None:
        """Update the QP's matrices for the state that is predicted."""
        self._planner.prepare()

    def warm_up(self) -> None:
        """Dry-run the planning to warm the caches."""
        self._planner.warm_up()

    def forget(self) -> None:
        """No state of this period: the history of inputs and states has a gap."""
        self._planner.forget()
        self._low_speed.forget()

    def observe(
        self, state: VehicleState, applied: ControlInput, *, is_driven: bool, continues: bool
    ) -> VehicleState:
        """x_0 of this period, from its measured state and the input that acted until now.

        `is_driven`: this program drives the car. `continues`: no period lies between the last state
        and this one, and the input is known.
        """
        if not continues:
            self.forget()
        if not is_driven:
            self._low_speed.reset()
            self._planner.reset()
        if self._low_speed.law is not Mode.NOMINAL:
            self._planner.forget()  # the model has no data of so slow a car
        self._low_speed.observe(state, applied)
        return self._planner.observer.observe(state, applied)

    def observe_estimate(self, state: VehicleState, applied: ControlInput) -> VehicleState:
        """The same with an estimated state, for a stop."""
        self._low_speed.forget()
        return self._planner.observer.observe_estimate(state, applied)
