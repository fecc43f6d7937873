"""A control law of one's own in the place of the MPC: an observation in, one input out."""

import time
from collections.abc import Sequence
from numbers import Real
from typing import NamedTuple, Protocol

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.preview import KNOTS, SHORTEST_SPACING_M
from rt_controller.contract.signals import (
    N_INPUTS,
    NEUTRAL_INPUT,
    ControlInput,
    CurvaturePreview,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import HOLD_PLAN_TICKS
from rt_controller.control.estimator import MOTION_GAIN
from rt_controller.control.observer import StateObserver
from rt_controller.control.program import SolveStatus
from rt_controller.model.bundle import Bundle

_EXPECTED = f"a ControlInput of {N_INPUTS} finite numbers"


class Observation(NamedTuple):
    """What a control law receives once a period, in SI units."""

    state: VehicleState
    """measured now"""
    curvature_per_m: float
    """of the road's reference line at the car"""
    path: PathReference
    """lateral position and speed that are wanted ahead"""
    preview: CurvaturePreview
    """curvature of the road's reference line ahead"""
    previous: ControlInput
    """the input that was sent in the last period"""
    under_way: tuple[ControlInput, ...] = ()
    """inputs that were sent and do not act yet, the oldest first: one for each period of delay"""
    most_steer_rad: float = INPUT_LIMITS.upper.steer_rad
    """largest angle of the steering wheel at this speed"""


class ControlLaw(Protocol):
    """One input a period from one observation.

    It may have a method `reset()`: then that is called where the next observation does not follow
    on the last one, and in the first periods, until it is known which input acts. What is
    integrated begins again there.
    """

    def control(self, now: Observation) -> ControlInput:
        """Pedals and steering wheel of this period, which are limited before they are sent.

        An exception, or something else than three finite numbers, is treated as a QP that is not
        solved: the last input is held, then the car is stopped.
        """


class LawPlanner:
    """A control law with the methods of `Mpc`.

    The state is observed with a model as for `Mpc`, because the checks of the motion predict with
    the lifted state. The law gets the state as it was measured.
    """

    iterations, periods_under_way = 1, 0
    max_iterations: int | None = None

    def __init__(self, bundle: Bundle, law: ControlLaw, name: str) -> None:
        self.name = name
        self.observer = StateObserver(bundle, 0, MOTION_GAIN)
        self.inputs = np.zeros((HOLD_PLAN_TICKS + 1, N_INPUTS))
        """(3, 3), the input of this period, held"""
        self.failure: BaseException | None = None
        """why the law gave no input for the first time"""
        self.solve_ns = 0
        """time that the law needed last"""
        self._law = law
        self._acting = NEUTRAL_INPUT
        self._most_steer_rad = INPUT_LIMITS.upper.steer_rad
        self._has_plan = self._is_continued = False

    def plan(
        self,
        x_0: VehicleState,
        curvature_per_m: float,
        path: PathReference,
        previous: ControlInput,
        preview: CurvaturePreview | None = None,
        under_way: Sequence[ControlInput] = (),
    ) -> SolveStatus:
        """As `Mpc.plan`; without a `preview` the law gets one of constant curvature."""
        self.observer.lift(x_0, curvature_per_m)
        ahead = preview or CurvaturePreview(SHORTEST_SPACING_M, *(curvature_per_m,) * KNOTS)
        state, sent = self.observer.measured, tuple(under_way)
        now = Observation(state, curvature_per_m, path, ahead, previous, sent, self._most_steer_rad)
        begun_ns = time.perf_counter_ns()
        try:
            self._control(now)
        except (Exception, SystemExit) as error:  # of code that this program does not know
            self.failure = self.failure or error
            self._has_plan = False
        self.solve_ns = time.perf_counter_ns() - begun_ns
        if not self._has_plan:
            return SolveStatus.NUMERICS
        self._acting = under_way[0] if under_way else ControlInput(*self.inputs[0].tolist())
        return SolveStatus.SOLVED

    def _control(self, now: Observation) -> None:
        """Take the law's input as the plan."""
        if not self._is_continued:
            reset = getattr(self._law, "reset", None)
            if reset is not None:
                reset()
            self._is_continued = True
        found = self._law.control(now)
        numbers = np.asarray(found, dtype=object)
        is_numeric = all(isinstance(number, Real) for number in numbers.flat)
        if not (is_numeric and numbers.shape == (N_INPUTS,)):
            raise TypeError(f"it returned {found!r:.80}, expected {_EXPECTED}")
        inputs = numbers.astype(np.float64)
        if not np.isfinite(inputs).all():
            raise ValueError(f"it returned {found!r:.80}, expected {_EXPECTED}")
        self.inputs[:] = inputs
        self._has_plan = True

    def prepare(self) -> None:
        """Predict the next state, for the checks."""
        if self._has_plan:
            self.observer.advance(self._acting)
        self._has_plan = False

    def forget(self) -> None:
        """The next observation does not follow on the last one."""
        self._has_plan = self._is_continued = False
        self.observer.forget()

    def reset(self) -> None:
        """Another drive begins."""
        self.forget()
        self.observer.reset()

    def resume(self, previous: ControlInput) -> None:
        """Another law made the last inputs."""
        self._is_continued = False

    def predicted_states(self) -> Array | None:
        """None: a law predicts nothing."""
        return None

    def limit_steering(self, most_rad: float, rate_radps: float) -> None:
        """Tell the law how far the wheel may turn."""
        self._most_steer_rad = most_rad

    def limit_solve_time(self, budget_ns: int) -> None:
        """Do nothing: the time of a law cannot be limited, and the deadline is monitored."""

    def warm_up(self) -> None:
        """Do nothing: a dry run could change what the law integrates."""
