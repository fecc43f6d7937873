"""The supervisor: checks what a tick received, and replaces what is lost or implausible.

It depends on neither solver nor planner. Its inputs are what was received and what was sent; its
result is a state and a path to plan from, and the cause of a stop.
"""

from collections.abc import Sequence
from functools import reduce
from math import atan, inf
from operator import or_

from rt_controller.contract.arrays import Array
from rt_controller.contract.braking import stop_speed_mps
from rt_controller.contract.faults import Fault, StopCause
from rt_controller.contract.kinematics import (
    farthest_m,
    heading_change_rad,
    lateral_change_m,
    progress_m,
    speed_of,
)
from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import AT_REST, ControlInput, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.model.validity import Excess, TrainedRange
from rt_controller.safety.checks import CHECKS, NEVER, NOT_COMPUTED, Check
from rt_controller.safety.coast_model import PedalEffect, StoppingCar
from rt_controller.safety.freshness import ON_TIME, SampleTime
from rt_controller.safety.isolation import (
    Faulty,
    Finding,
    SignalMask,
    Windows,
    finding_of,
    finding_of_state,
    isolate_path,
)
from rt_controller.safety.motion import (
    MOVING_MPS,
    MotionPrediction,
    Residuals,
    have_moved,
    with_replaced_signals,
)
from rt_controller.safety.path import LastPath, LastRoad, PathChecks
from rt_controller.safety.sent_commands import SentCommands
from rt_controller.safety.stop import Braking, braking_for
from rt_controller.safety.tick import Estimate, Tick

_NOT_COMPUTED = [NOT_COMPUTED] * len(Quantity)
_OF_STATE = range(Quantity.PROGRESS_STEP_M, Quantity.FROZEN_TICKS + 1)
_OF_CAR = range(Quantity.STEERING_RAD, Quantity.TRACKING_M + 1)
_OF_REPORT = range(Quantity.SPEED_MPS, Quantity.OUTSIDE_TRAINING + 1)
_OF_PATH = range(Quantity.PATH_STEP_M, Quantity.PATH_LATERAL_MPS2 + 1)
_OF_ENGAGEMENT = range(Quantity.PATH_LATERAL_MPS2, Quantity.ENGAGE_EPSI_RAD + 1)
_GROUPS = (_OF_STATE, _OF_CAR, _OF_REPORT, _OF_PATH, _OF_ENGAGEMENT)
MAX_REJECTIONS, REJECTION_DECAY_PER_TICK = 4.0, 0.1
"""a state or path that is rejected more often, in a row or not, stops the car"""


class Supervisor:
    """Checks every tick of a drive; one instance for a controller."""

    def __init__(
        self,
        prediction: MotionPrediction | None = None,
        car: StoppingCar | None = None,
        checks: Sequence[Check] = CHECKS,
        trained: TrainedRange | None = None,
        actuation_periods: int = 1,
    ) -> None:
        """With no `checks` everything is accepted; lost states and paths are still estimated.

        `trained` is that of the model that drives; None: not known, and not compared.
        `actuation_periods`: delay of all actuators that is configured.
        """
        limits = [NEVER] * len(Quantity)
        for check in checks:
            limits[check.quantity] = check.threshold
        self.checks = checks
        self.values = list(_NOT_COMPUTED)
        """of this tick, by `Quantity`; overwritten by the next"""
        self._windows = Windows(self.values, checks, _GROUPS)
        self.failing = self._windows.failed
        """checks of this tick; overwritten by the next"""
        self._car = car or StoppingCar()
        self._prediction, self._trained = prediction, trained
        self._residuals = Residuals(self.values, prediction, limits)
        self._paths = PathChecks(self.values)
        self._road = LastRoad(self.values, limits[Quantity.PREVIEW_STEP_PER_M])
        self.sent = SentCommands(actuation_periods)
        self._pedals = PedalEffect(self._car.throttle_mps2, self._car.brake_mps2_per_n)
        self._state: VehicleState | None = None
        self._curvature_per_m = 0.0
        self._faulty: SignalMask = Faulty.NONE
        self._rejections = 0.0
        self._is_motion_measured = False
        self._stop_mps = inf
        self._late_m = self._jitter_s = 0.0

    def check(self, tick: Tick) -> Estimate:
        """State and path of this tick to plan from, and the cause of a stop or of a rejection."""
        self.values[:] = _NOT_COMPUTED
        self.failing.clear()
        self._late_m = 0.0
        before = self._state
        if before is None or not tick.is_driven:
            return self._begin(tick)
        self._road.move(before.vx_mps * PERIOD_S * tick.periods)
        if not self._faulty & Faulty.PREVIEW:
            self._road.take(tick.preview, None if tick.state is None else tick.curvature_per_m)
        state, failed_state = self._check_state(tick, before)
        if tick.is_stopping:
            self._stop_mps = stop_speed_mps(self._stop_mps, state.vx_mps, tick.periods)
        failed_path = self._check_path(tick, state)
        self._compare_car(tick, state, failed_state is None, failed_path is None)
        failing = self._windows.failing(_OF_CAR)
        failed_car = finding_of(failing, [Faulty.NONE] * len(failing)) if failing else None
        alarm = rejection = StopCause.NONE
        for failed in (failed_state, failed_path, failed_car):
            if failed is None:
                continue
            is_stop = failed.is_stop
            if is_stop or tick.is_stopping:
                self._faulty |= failed.faulty
            if is_stop and alarm is StopCause.NONE:
                alarm = failed.cause
            elif rejection is StopCause.NONE:
                rejection = failed.cause
        self._rejections = max(self._rejections - REJECTION_DECAY_PER_TICK, 0.0)
        if rejection is not StopCause.NONE:
            self._rejections += 1.0
            if self._rejections > MAX_REJECTIONS and alarm is StopCause.NONE:
                alarm = rejection
        estimate = self._estimate(tick, state, failed_state, failed_path, alarm, rejection)
        if estimate.path is not None and not tick.is_stopping:
            self.values[Quantity.SPEED_MPS] = abs(state.vx_mps - estimate.path.v_mps)
        trained = self._trained
        excess = None if trained is None else self._compare_training(trained, state)
        reported = self._windows.failing(_OF_REPORT)
        if not reported:
            return estimate
        report = reduce(or_, (each.cause.fault for each in reported))
        return estimate._replace(
            report=report, excess=excess if Fault.OUTSIDE_TRAINING in report else None
        )

    def note(self, control: ControlInput, psi: Array | None, counter: int | None = None) -> None:
        """After the tick: what was sent, and the lifted state (n,) that the model starts from."""
        self.sent.add(control, counter)
        prediction = self._prediction
        if psi is None or prediction is None:
            return
        if self._is_motion_measured or not prediction.has_any or prediction.is_old:
            prediction.begin(psi)

    def prepare(self, applied: ControlInput) -> None:
        """Before a tick, while there is time: predict the motion under the input that will act."""
        if self._prediction is not None:
            self._prediction.prepare(applied, self._curvature_per_m)

    def clear_predictions(self) -> None:
        """The model does not describe the present motion: another law or the vehicle drives."""
        if self._prediction is not None:
            self._prediction.clear()

    def braking(
        self, estimate: Estimate, steer_rad: float, is_held: bool, force_scale: float
    ) -> Braking:
        """How a safe stop of a car in the accepted state brakes, with this angle of the wheel."""
        return braking_for(
            estimate.alarm,
            estimate.speed_mps is not None and estimate.is_path_received,
            self._state or AT_REST,
            steer_rad,
            self._car.geometry,
            self._stop_mps,
            self.values[Quantity.THROTTLE],
            force_scale,
            is_held,
        )

    def _begin(self, tick: Tick) -> Estimate:
        """Restart; a car outside of the engagement window is refused."""
        self._faulty = Faulty.NONE
        self._rejections = 0.0
        self._stop_mps = inf
        self._state, self._curvature_per_m = tick.state, tick.curvature_per_m
        self._windows.begin()
        self._paths.begin()
        self._road.begin(tick.preview)
        self._pedals.begin()
        self.clear_predictions()
        failing: list[Check] = []
        path = tick.path
        if tick.state is not None:
            self._residuals.begin(tick.state)
            if path is not None:
                state, values = tick.state, self.values
                road = tick.curvature_per_m, tick.preview, state.vx_mps
                self._paths.compare(path, *road)
                heading_rad = state.epsi_rad - atan(path.c1)
                away_mps = state.vx_mps * heading_rad + state.vy_mps
                values[Quantity.ENGAGE_EY_M] = farthest_m(state.ey_m - path.c0_m, away_mps)
                slip_rad = state.vy_mps / max(state.vx_mps, MOVING_MPS)  # of a car in a bend
                values[Quantity.ENGAGE_EPSI_RAD] = abs(heading_rad + slip_rad)
                failing = self._windows.failing(_OF_ENGAGEMENT)
                self._paths.accept(path, state.vx_mps)
                path = self._paths.follow(path, state.vx_mps, tick.periods)
        return Estimate(
            tick.state,
            tick.curvature_per_m,
            path,
            None if tick.has_implausible_preview else tick.preview,
            tick.state is not None and not failing,
            tick.path is not None,
            None if tick.state is None else tick.state.vx_mps,
            rejection=StopCause.NOT_ENGAGED if failing else StopCause.NONE,
        )

    def _check_state(self, tick: Tick, before: VehicleState) -> tuple[VehicleState, Finding | None]:
        """The accepted state, and which measured signals contradict it, if any."""
        residuals, faulty = self._residuals, self._faulty
        self._is_motion_measured = False
        vx_mps, vy_mps, yaw_rate = self._expected_motion(tick, before)
        expected = before._replace(
            vx_mps=vx_mps, vy_mps=vy_mps, yaw_rate_radps=yaw_rate, ds_m=vx_mps * PERIOD_S
        )
        last_curvature_per_m = self._curvature_per_m
        road_per_m = self._road.curvature_here(last_curvature_per_m)
        if tick.state is None:
            self._curvature_per_m = road_per_m
            mean_per_m = 0.5 * (last_curvature_per_m + road_per_m)
            state = residuals.advance(before, expected, mean_per_m, tick.periods, Faulty.STATE)
            self._state = state
            return state, None

        observed, failed = residuals.observed, None
        curvature_per_m = road_per_m
        if not faulty & Faulty.CURVATURE:
            curvature_per_m = tick.curvature_per_m
            self._road.compare(curvature_per_m)
        mean_per_m = 0.5 * (last_curvature_per_m + curvature_per_m)
        regular = (
            tick.state
            if tick.sample_time is ON_TIME
            else self._at_regular_time(tick.state, tick.sample_time, before, expected)
        )
        measured = with_replaced_signals(regular, expected, faulty)
        state = residuals.advance(before, measured, mean_per_m, tick.periods, faulty)
        actuators = None if have_moved(tick.applied, tick.feedback) else tick.feedback
        residuals.compare(before, state, tick.state, mean_per_m, tick.periods, actuators)
        self._compare_pedals(tick, before.vx_mps, state.vx_mps)
        failing = self._windows.failing(_OF_STATE)
        if failing:
            evidence = residuals.evidence(before, state, abs(curvature_per_m - road_per_m))
            evidence = evidence._replace(estimated=faulty)
            failed = finding_of_state(failing, evidence, residuals.is_repeated)
            if tick.is_stopping and not failed.faulty:
                failed = None  # the grip or an actuator explains it: nothing more to do in a stop
        if failed is not None:
            is_new = failed.faulty & Faulty.MOTION and not faulty & Faulty.MOTION
            if failed.is_stop and is_new and self._prediction is not None:
                self._prediction.fall_back()  # the motion was wrong for some time
            faulty |= failed.faulty
            if faulty & (Faulty.SPEED | Faulty.PROGRESS):
                residuals.clear_speed_difference()
            residuals.observed = observed  # advance again, without the signal that is faulty
            if faulty & Faulty.CURVATURE:
                curvature_per_m = road_per_m
                mean_per_m = 0.5 * (last_curvature_per_m + curvature_per_m)
            measured = with_replaced_signals(regular, expected, faulty)
            state = residuals.advance(before, measured, mean_per_m, tick.periods, faulty)
            if failed.is_stop:
                residuals.correct(state, faulty)
                self._paths.blend(before, state, tick.periods)
        residuals.follow(state, faulty)
        self._is_motion_measured = not faulty & Faulty.MOTION
        self._state, self._curvature_per_m = state, curvature_per_m
        return state, failed

    def _at_regular_time(
        self, state: VehicleState, time: SampleTime, before: VehicleState, expected: VehicleState
    ) -> VehicleState:
        """A measured state moved to the regular time of its sample, a period after `before`.

        A vehicle may stamp otherwise than it samples: a stamp counts if Δs agrees better with it
        than with a period. If the sample before was lost, Δs may be of any interval in the jitter.
        """
        late_s, longer_s = time
        if longer_s is None:
            late_s = min(max(late_s, -self._jitter_s), self._jitter_s)
        step_m = progress_m(before, state, self._curvature_per_m)
        along_mps, excess_m = step_m / PERIOD_S, state.ds_m - step_m
        if longer_s is None:
            interval_s = excess_m / max(along_mps, MOVING_MPS)
            least_s, most_s = min(late_s - self._jitter_s, 0.0), max(late_s + self._jitter_s, 0.0)
            longer_s = min(max(interval_s, least_s), most_s)
        elif abs(excess_m - along_mps * longer_s) >= abs(excess_m):
            return state
        self._jitter_s = max(self._jitter_s, abs(late_s))
        self._late_m, share = along_mps * late_s, late_s / PERIOD_S
        if self._prediction is not None and self._prediction.has_any:
            state = state._replace(
                vx_mps=state.vx_mps - share * (expected.vx_mps - before.vx_mps),
                vy_mps=state.vy_mps - share * (expected.vy_mps - before.vy_mps),
                yaw_rate_radps=state.yaw_rate_radps
                - share * (expected.yaw_rate_radps - before.yaw_rate_radps),
            )
        turned_rad = heading_change_rad(state, state, self._curvature_per_m, step_m)
        return state._replace(
            ds_m=state.ds_m - along_mps * longer_s,
            ey_m=state.ey_m - share * lateral_change_m(state, state),
            epsi_rad=state.epsi_rad - share * turned_rad,
        )

    def _compare_pedals(self, tick: Tick, before_mps: float, now_mps: float) -> None:
        """Compare a slow car with its pedals; a faster one is compared with the model."""
        if tick.applied is None or max(before_mps, now_mps) > self._car.modelled_mps:
            self._pedals.begin()
            return
        missing_mps = self._pedals.missing_mps(tick.applied, before_mps, now_mps, tick.periods)
        self.values[Quantity.PEDAL_SPEED_MPS] = missing_mps

    def _expected_motion(self, tick: Tick, before: VehicleState) -> tuple[float, float, float]:
        """(v_x, v_y, yaw rate) of this tick by the model, or by braking where it has none."""
        applied = self.sent.newest if tick.state is None else tick.applied
        prediction = self._prediction
        if applied is None:
            self.clear_predictions()
            applied = self.sent.newest
        if before.vx_mps < self._car.modelled_mps:
            self.clear_predictions()
        if prediction is None or not prediction.has_any:
            return self._car.motion(before.vx_mps, applied)
        for _ in range(min(tick.periods, 4)):
            prediction.advance(applied, self._curvature_per_m)
        return prediction.newest()

    def _check_path(self, tick: Tick, state: VehicleState) -> Finding | None:
        paths = self._paths
        paths.move(state.ds_m * tick.periods, state.vx_mps)
        path = None if self._faulty & Faulty.PATH else tick.path
        if path is not None:
            preview = self._road.ahead(tick.preview)
            road = self._curvature_per_m, preview, state.vx_mps
            paths.compare(path, *road)
        failing = self._windows.failing(_OF_PATH)
        found = finding_of(failing, [isolate_path(each) for each in failing]) if failing else None
        if found is not None and found.faulty & Faulty.PATH:
            paths.reject()
        elif path is not None:
            is_speed_wrong = any(each.quantity is Quantity.PATH_SPEED_STEP_MPS for each in failing)
            paths.accept(path, state.vx_mps, keeps_speed=is_speed_wrong)
        return found

    def _compare_car(
        self, tick: Tick, state: VehicleState, is_state_good: bool, is_path_good: bool
    ) -> None:
        values = self.values
        if tick.feedback is not None:
            outside = self.sent.outside(tick.feedback, tick.late_ticks)
            values[Quantity.THROTTLE], values[Quantity.BRAKE_N], values[Quantity.STEERING_RAD] = (
                outside
            )
        is_known = tick.state is not None and is_state_good and is_path_good
        if tick.path is not None and is_known and not tick.is_stopping:
            values[Quantity.TRACKING_M] = abs(state.ey_m - tick.path.c0_m)

    def _compare_training(self, trained: TrainedRange, state: VehicleState) -> Excess | None:
        """What is outside of the training of the model, at speeds at which it drives."""
        speed_mps = state.vx_mps
        if speed_mps < self._car.modelled_mps:
            return None
        lateral_mps2 = speed_mps * state.yaw_rate_radps
        steer_rad = self.sent.newest.steer_rad
        excess = trained.excess(speed_mps, lateral_mps2, steer_rad, self._curvature_per_m)
        self.values[Quantity.OUTSIDE_TRAINING] = 0.0 if excess is None else excess.share
        return excess

    def _estimate(
        self,
        tick: Tick,
        state: VehicleState,
        failed_state: Finding | None,
        failed_path: Finding | None,
        alarm: StopCause,
        rejection: StopCause,
    ) -> Estimate:
        faulty, last = self._faulty, self._paths.last
        if failed_state is not None:
            faulty |= failed_state.faulty
        is_measured = tick.state is not None and not faulty & (Faulty.STATE | Faulty.CURVATURE)
        is_speed_wrong = failed_path is not None and not failed_path.faulty
        is_path = tick.path is not None and not faulty & Faulty.PATH
        is_path = is_path and (failed_path is None or (is_speed_wrong and tick.is_stopping))
        path, preview = tick.path, tick.preview
        if path is not None and self._late_m != 0.0:
            path = LastPath(path, inf, -self._late_m).path_here()
        is_replaced = failed_path is None or failed_path.faulty & Faulty.PATH
        if is_speed_wrong or (is_replaced and not is_path):
            path = None if last is None else last.path_here()
        if path is not None:
            path = self._paths.follow(path, state.vx_mps, tick.periods)
            if tick.is_stopping and not faulty & Faulty.LATERAL_MOTION:
                # The place of each stage is that of a car that brakes. With an estimated yaw rate
                # on a wet road this was worse: docs/safety.md, Not covered.
                braking_mps2 = self._car.brake_mps2_per_n * self.sent.newest.brake_n
                path = path._replace(v_mps=state.vx_mps, a_mps2=-braking_mps2)
        is_stop = tick.is_stopping or alarm is not StopCause.NONE
        if tick.state is None or faulty & Faulty.CURVATURE or (is_stop and preview is not None):
            preview = self._road.ahead(preview)
        elif tick.has_implausible_preview and not is_stop:
            preview = None
        is_slow_known = not faulty & Faulty.SPEED or not faulty & Faulty.PROGRESS
        speed_mps = speed_of(state) if tick.state is not None and is_slow_known else None
        return Estimate(
            state,
            self._curvature_per_m,
            path,
            preview,
            is_measured,
            is_path,
            speed_mps,
            alarm,
            rejection,
            stops=is_stop,
        )
