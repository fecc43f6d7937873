"""The motion: predicted by the model, and its residuals against what arrives.

Two slow observers integrate heading and lateral error from the motion and follow the measured ones
with a time constant: the residual contains a jump at once, and a drift within that time.
"""

from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from math import radians
from typing import NamedTuple

from rt_controller.contract.arrays import Array
from rt_controller.contract.kinematics import (
    heading_change_rad,
    lateral_change_along_m,
    lateral_change_m,
    progress_m,
)
from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import AT_REST, ControlInput, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.model.dynamics import Dynamics
from rt_controller.model.roll_outs import STEPS, DrivenStep, RollOuts
from rt_controller.safety.isolation import (
    LATERAL_SPEED_DIFFERS_MPS,
    YAW_RATE_DIFFERS_RADPS,
    Evidence,
    Faulty,
    SignalMask,
)

LONGEST = 80
"""steps of a roll-out: one of two seconds is more accurate than to lift the predicted state again
in every period"""


class MotionPrediction:
    """The motion by roll-outs of the model that began in the last ten ticks."""

    def __init__(self, model: Dynamics, n_observables: int) -> None:
        self._roll_outs = RollOuts(n_observables, DrivenStep(model))
        self._age_of_newest = 0
        self._ahead: tuple[ControlInput, float, Array] | None = None
        """roll-outs of the next tick, and the input and the curvature that they expect"""

    @property
    def has_any(self) -> bool:
        return self._roll_outs.begun > 0

    @property
    def has_ten(self) -> bool:
        """True if a roll-out was begun ten ticks ago."""
        return self._roll_outs.begun >= STEPS and self._age_of_newest == 1

    @property
    def is_old(self) -> bool:
        """True if the newest roll-out is longer than those that the model was trained with."""
        return self._age_of_newest >= LONGEST

    def begin(self, psi: Array) -> None:
        """Begin a roll-out at the lifted state (n,) of this tick; the oldest one ends."""
        if self._age_of_newest > 1:
            self._roll_outs.begun = 0
        self._roll_outs.begin(psi)
        self._age_of_newest = 0
        self._ahead = None

    def prepare(self, applied: ControlInput, curvature_per_m: float) -> None:
        """Before a tick, while there is time: roll out one step with the input that is expected."""
        if self.has_any:
            after = self._roll_outs.after(applied, curvature_per_m)
            self._ahead = applied, curvature_per_m, after

    def advance(self, applied: ControlInput, curvature_per_m: float) -> None:
        """Advance all roll-outs by the period in which `applied` acted."""
        ahead, self._ahead = self._ahead, None
        if ahead is None or ahead[:2] != (applied, curvature_per_m):
            ahead = applied, curvature_per_m, self._roll_outs.after(applied, curvature_per_m)
        self._roll_outs.advance(ahead[2])
        self._age_of_newest += 1

    def fall_back(self) -> None:
        """Go on with the roll-out that began ten ticks ago, since later states were faulty."""
        if self.has_ten:
            self._roll_outs.restart_from_oldest()
            self._age_of_newest = STEPS
            self._ahead = None

    def clear(self) -> None:
        """End all roll-outs."""
        self._roll_outs.begun = self._age_of_newest = 0
        self._ahead = None

    def newest(self) -> tuple[float, float, float]:
        """(v_x, v_y, yaw rate) by the roll-out that began last."""
        vx, vy, yaw_rate = self._roll_outs.newest[:3].tolist()
        return vx, vy, yaw_rate

    def oldest(self) -> tuple[float, float, float]:
        """The same by the one that began ten ticks ago."""
        vx, vy, yaw_rate = self._roll_outs.oldest[:3].tolist()
        return vx, vy, yaw_rate


MEMORY_S = 2.0
"""time constant of the observers of heading and lateral error"""
OBSERVER_GAIN = PERIOD_S / MEMORY_S
LOW_PASS_GAIN = 0.1
"""of one tick, in the low-pass of the difference of v_x and the speed from the progress"""
LARGEST_DIFFERENCE_MPS = 2.0
"""of one tick in that low-pass; the check of one step finds a single outlier"""
MOVING_MPS = 1.0
"""a slower car may stand, with a constant state"""
MOVED_M, TURNED_RAD = 0.005, 0.0008
"""least change of e_y and e_psi, by the other states, that contradicts constant values"""
SIDEWAYS_MPS, TURNING_RADPS = 0.04, 0.004
"""smaller rates are those of rounded or slightly wrong signals of a steady car"""
MOVED_ACTUATORS = ControlInput(throttle=0.1, brake_n=10.0, steer_rad=radians(3.0))
"""change of the actuators since the states are constant that contradicts them"""
REMEMBERED_STATES = 40
"""of one second; older states differ so much from the present one that other checks fail"""
CHANGED_SIGNALS = 3
"""least number of signals that differ between two states; else the car drives steadily"""
SMALL_LATERAL_M, SLOW_TICKS = 0.1, round(1.2 / PERIOD_S)
"""a residual of e_y that grows more slowly from there to its threshold is less than 0.3 m/s"""
JUMP_SHARE = 0.5
"""of a residual; if more of it appears within one period, it is a jump"""


class Observed(NamedTuple):
    """Place of the car as integrated from its motion."""

    ey_m: float
    epsi_rad: float
    ey_by_yaw_rate_m: float
    """with the heading that is integrated from the yaw rate"""


class Residuals:
    """Residuals of the present tick, and the observers behind them."""

    def __init__(
        self, values: list[float], prediction: MotionPrediction | None, limits: Sequence[float]
    ) -> None:
        """`values` are filled in, `limits` are the thresholds, both by `Quantity`."""
        self._values = values
        self._limits = limits
        self._prediction = prediction
        self._received: deque[VehicleState] = deque(maxlen=REMEMBERED_STATES)
        self._is_heading_jump = self._is_lateral_jump = False
        """of the tick in which the residual exceeded its threshold, while it stays above it"""
        self.begin(AT_REST)

    def begin(self, state: VehicleState) -> None:
        """Restart at a state that is accepted."""
        self.observed = Observed(state.ey_m, state.epsi_rad, state.ey_m)
        self._speed_difference_mps = self._heading_rad = self._lateral_m = 0.0
        self._same_ticks = self._frozen_ticks = self._lateral_ticks = 0
        self._raw: VehicleState | None = None
        self._actuators: ControlInput | None = None
        """their feedback when the state began to repeat"""
        self._received.clear()

    def advance(
        self,
        before: VehicleState,
        now: VehicleState,
        mean_curvature_per_m: float,
        periods: int,
        faulty: SignalMask,
    ) -> VehicleState:
        """`now`, its faulty place replaced by the integrated one, `periods` after `before`."""
        ey_m, epsi_rad, ey_by_yaw_rate_m = self.observed
        turned = heading_change_rad(before, now, mean_curvature_per_m, now.ds_m)
        integrated_rad = epsi_rad + periods * turned
        if faulty & Faulty.HEADING:
            now = now._replace(epsi_rad=integrated_rad)
        ey_m += periods * lateral_change_m(before, now)
        mean_rad = 0.5 * (epsi_rad + integrated_rad)
        ey_by_yaw_rate_m += periods * lateral_change_along_m(before, now, mean_rad)
        if faulty & Faulty.LATERAL_ERROR:
            now = now._replace(ey_m=ey_m)
        self.observed = Observed(ey_m, integrated_rad, ey_by_yaw_rate_m)
        return now

    def clear_speed_difference(self) -> None:
        """Restart the comparison of v_x and Δs: one of the two is faulty."""
        self._speed_difference_mps = 0.0

    def follow(self, state: VehicleState, faulty: SignalMask) -> None:
        """Let the observers follow what is not faulty in the state of this tick."""
        ey_m, epsi_rad, ey_by_yaw_rate_m = self.observed
        if not faulty & Faulty.HEADING:
            epsi_rad += OBSERVER_GAIN * (state.epsi_rad - epsi_rad)
        if not faulty & Faulty.LATERAL_ERROR:
            ey_by_yaw_rate_m += OBSERVER_GAIN * (state.ey_m - ey_by_yaw_rate_m)
            ey_m += OBSERVER_GAIN * (state.ey_m - ey_m)
        self.observed = Observed(ey_m, epsi_rad, ey_by_yaw_rate_m)

    def correct(self, state: VehicleState, faulty: SignalMask) -> None:
        """After a drift of e_y that v_y has caused: go on from the e_y that is measured."""
        ey_m, epsi_rad, ey_by_yaw_rate_m = self.observed
        if faulty & Faulty.LATERAL_SPEED and not faulty & Faulty.LATERAL_ERROR:
            ey_m = ey_by_yaw_rate_m = state.ey_m
        self.observed = Observed(ey_m, epsi_rad, ey_by_yaw_rate_m)

    def compare(
        self,
        before: VehicleState,
        now: VehicleState,
        received: VehicleState,
        curvature_per_m: float,
        periods: int,
        actuators: ControlInput | None = None,
    ) -> None:
        """Fill in the values of a state, after the observers were advanced to it.

        `now` is the `received` state without the signals that are faulty; `actuators` is
        their feedback, if it is new and they follow their commands.
        """
        values, share = self._values, 1.0 / periods
        self._received.append(received)
        difference_m = now.ds_m - progress_m(before, now, curvature_per_m)
        difference_mps = min(
            max(difference_m / PERIOD_S, -LARGEST_DIFFERENCE_MPS), LARGEST_DIFFERENCE_MPS
        )
        self._speed_difference_mps += LOW_PASS_GAIN * (difference_mps - self._speed_difference_mps)
        heading_rad = now.epsi_rad - self.observed.epsi_rad
        lateral_m = now.ey_m - self.observed.ey_m
        values[Quantity.PROGRESS_STEP_M] = abs(difference_m) * share
        values[Quantity.PROGRESS_SPEED_MPS] = abs(self._speed_difference_mps)
        values[Quantity.HEADING_RAD] = abs(heading_rad) * share
        values[Quantity.LATERAL_ERROR_M] = abs(lateral_m) * share
        if abs(self._heading_rad) <= self._limits[Quantity.HEADING_RAD]:
            self._is_heading_jump = _is_jump(self._heading_rad, heading_rad)
        self._lateral_ticks += 1
        if abs(lateral_m) < SMALL_LATERAL_M:
            self._lateral_ticks = 0
        if abs(self._lateral_m) <= self._limits[Quantity.LATERAL_ERROR_M]:
            self._is_lateral_jump = _is_jump(self._lateral_m, lateral_m)
        self._heading_rad, self._lateral_m = heading_rad, lateral_m
        self._count_frozen(received, actuators, curvature_per_m)
        prediction, changed_mps = self._prediction, abs(now.vx_mps - before.vx_mps)
        values[Quantity.SPEED_STEP_MPS] = changed_mps * share
        if prediction is None or not prediction.has_any:
            return
        vx, vy, yaw_rate = prediction.newest()
        # A car that slides is far from the data of the model: then the prediction jumps, not v_x.
        values[Quantity.SPEED_STEP_MPS] = min(abs(now.vx_mps - vx), changed_mps) * share
        values[Quantity.LATERAL_SPEED_STEP_MPS] = abs(now.vy_mps - vy) * share
        values[Quantity.YAW_RATE_STEP_RADPS] = abs(now.yaw_rate_radps - yaw_rate) * share
        if prediction.has_ten:
            vx, vy, yaw_rate = prediction.oldest()
            values[Quantity.SPEED_TEN_MPS] = abs(now.vx_mps - vx)
            values[Quantity.LATERAL_SPEED_TEN_MPS] = abs(now.vy_mps - vy)
            values[Quantity.YAW_RATE_TEN_RADPS] = abs(now.yaw_rate_radps - yaw_rate)

    def _count_frozen(
        self, now: VehicleState, actuators: ControlInput | None, curvature_per_m: float
    ) -> None:
        """A car in steady motion may repeat its state.

        One that moves by the other states, or whose actuators have moved, cannot. The model is no
        evidence: it knows neither grade and bank nor wind.
        """
        values = self._values
        values[Quantity.FROZEN_TICKS] = 0.0
        if now != self._raw or now.vx_mps < MOVING_MPS:
            self._raw, self._actuators = now, actuators
            self._same_ticks = self._frozen_ticks = 0
            return
        self._same_ticks += 1
        if self._actuators is None:
            self._actuators = actuators
        sideways_m = lateral_change_m(now, now)
        turned_rad = heading_change_rad(now, now, curvature_per_m, now.ds_m)
        is_changing = (
            _is_above(sideways_m, self._same_ticks, SIDEWAYS_MPS * PERIOD_S, MOVED_M)
            or _is_above(turned_rad, self._same_ticks, TURNING_RADPS * PERIOD_S, TURNED_RAD)
            or have_moved(self._actuators, actuators)
        )
        self._frozen_ticks = self._frozen_ticks + 1 if is_changing else 0
        values[Quantity.FROZEN_TICKS] = self._frozen_ticks

    @property
    def is_repeated(self) -> bool:
        """True if the last two states are also two states in a row of the last second."""
        if len(self._received) < 2:
            return False
        *earlier, before, now = self._received
        has_changed = sum(a != b for a, b in zip(before, now, strict=True)) >= CHANGED_SIGNALS
        return has_changed and (before, now) in pairwise(earlier)

    def evidence(
        self, before: VehicleState, now: VehicleState, curvature_error_per_m: float
    ) -> Evidence:
        """Residuals that isolate the faulty signal, after `compare`."""
        prediction, expected_mps = self._prediction, before.vx_mps
        if prediction is not None and prediction.has_any:
            expected_mps = (prediction.oldest if prediction.has_ten else prediction.newest)()[0]
        return Evidence(
            speed_error_mps=abs(now.vx_mps - expected_mps),
            progress_error_mps=abs(now.ds_m / PERIOD_S - expected_mps),
            contradicts_lateral_speed=self._is_above(
                Quantity.LATERAL_SPEED_STEP_MPS, LATERAL_SPEED_DIFFERS_MPS
            ),
            contradicts_yaw_rate=self._is_above(
                Quantity.YAW_RATE_STEP_RADPS, YAW_RATE_DIFFERS_RADPS
            ),
            is_heading_jump=self._is_heading_jump,
            is_lateral_jump=self._is_lateral_jump,
            is_lateral_slow=self._lateral_ticks > SLOW_TICKS,
            lateral_by_heading_m=abs(now.ey_m - self.observed.ey_m),
            lateral_by_yaw_rate_m=abs(now.ey_m - self.observed.ey_by_yaw_rate_m),
            curvature_error_per_m=curvature_error_per_m,
        )

    def _is_above(self, step: Quantity, limits: tuple[float, float]) -> bool:
        """True if the residual of one step, or that of ten steps beside it, is larger."""
        return self._values[step] > limits[0] or self._values[step + 1] > limits[1]


def _is_above(change: float, ticks: int, least: float, largest: float) -> bool:
    """True if a change per tick is real, and more than `largest` over so many ticks."""
    return abs(change) > least and ticks * abs(change) > largest


def have_moved(before: ControlInput | None, now: ControlInput | None) -> bool:
    """True if one of two inputs that are known differs clearly."""
    if before is None or now is None:
        return False
    throttle, brake_n, steer_rad = MOVED_ACTUATORS
    return (
        abs(now.throttle - before.throttle) > throttle
        or abs(now.brake_n - before.brake_n) > brake_n
        or abs(now.steer_rad - before.steer_rad) > steer_rad
    )


def _is_jump(before: float, now: float) -> bool:
    return abs(now - before) > JUMP_SHARE * abs(now)


def with_replaced_signals(
    measured: VehicleState, expected: VehicleState, faulty: SignalMask
) -> VehicleState:
    """The measured state with the faulty signals of its motion replaced."""
    if faulty == Faulty.NONE:
        return measured
    vx_mps, vy_mps, yaw_rate, ds_m, ey_m, epsi_rad = measured
    if faulty & Faulty.SPEED:
        vx_mps = expected.vx_mps if faulty & Faulty.PROGRESS else ds_m / PERIOD_S
    if faulty & Faulty.PROGRESS:
        ds_m = vx_mps * PERIOD_S
    if faulty & Faulty.LATERAL_SPEED:
        vy_mps = expected.vy_mps
    if faulty & Faulty.YAW_RATE:
        yaw_rate = expected.yaw_rate_radps
    return VehicleState(vx_mps, vy_mps, yaw_rate, ds_m, ey_m, epsi_rad)
