"""The controller's end of a bus: what it receives with, decides with and sends with."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import can

from rt_controller.bundle_checks.plan_check import require_stored_plans
from rt_controller.bus.identity import model_hash
from rt_controller.bus.log.recorder import Recorder
from rt_controller.bus.messages import Node
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import Outbox
from rt_controller.config import ControllerConfig, LowSpeedSettings, MpcSettings
from rt_controller.contract.car import UNNAMED_CAR
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import SteeringGeometry
from rt_controller.contract.signals import AT_REST, NEUTRAL_INPUT, PathReference
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.eq14 import Corridor
from rt_controller.control.identification import identify_gains
from rt_controller.control.law import ControlLaw, LawPlanner
from rt_controller.control.low_speed import LowSpeedCar, LowSpeedLaw, PedalGains, SpeedRange
from rt_controller.control.mpc import Mpc
from rt_controller.control.planner import Planner
from rt_controller.control.program import SolveStatus
from rt_controller.control.warm_start import open_solver
from rt_controller.controllers import law_error, open_law
from rt_controller.model.bundle import Bundle
from rt_controller.model.validation import require_drivable
from rt_controller.native.planner import NativePlanner
from rt_controller.realtime.clock import TimeSource
from rt_controller.safety.checks import Check, checks_of
from rt_controller.safety.coast_model import LEAST_MODELLED_MPS, StoppingCar
from rt_controller.safety.motion import MotionPrediction
from rt_controller.safety.supervisor import Supervisor
from rt_controller.step import ControlStep


def build_planner(
    bundle: Bundle,
    config: ControllerConfig,
    law: ControlLaw | None = None,
    max_iterations: int | None = None,
) -> Planner:
    """What plans the inputs: the MPC with the model, or the law of the settings, or `law`.

    `max_iterations` of a solve; None: those of the solver.

    Raises:
        ArtifactError, ConfigError: as `build_mpc` and `open_law`.
        MissingExtraError: the law in C is not compiled, and cannot be compiled.
    """
    if law is not None or config.controller is not None:
        require_drivable(bundle)
        if law is not None:
            return LawPlanner(bundle, law, type(law).__name__)
        name = config.controller or ""
        return LawPlanner(bundle, open_law(name), name)
    if config.plan == "native":
        require_stored_plans(bundle)
        native = NativePlanner(bundle, config.mpc)
        plan_at_constant_speed(native)
        return native
    return build_mpc(bundle, config.mpc, max_iterations)


def build_mpc(bundle: Bundle, settings: MpcSettings, max_iterations: int | None = None) -> Mpc:
    """The planner of a loaded model, checked, its QP assembled and solved.

    `max_iterations` of a solve; None: those of the solver.

    Raises:
        ArtifactError: the model is not one of this vehicle, gives no convex QP, or does not plan
            as where it was exported.
        ConfigError: settings that give no QP, or one that is not solved at a constant speed.
    """
    require_drivable(bundle)
    require_stored_plans(bundle)
    settings = settings.for_model(bundle)
    corridor = None
    if settings.corridor_m is not None:
        corridor = Corridor(settings.corridor_m, settings.beyond_corridor_m)
    mpc = Mpc(
        bundle,
        settings.horizon,
        settings.cost(),
        corridor,
        partial(open_solver, max_iterations=max_iterations),
        settings.knots,
        settings.disturbance_gain,
    )
    plan_at_constant_speed(mpc)
    return mpc


def choose_low_speed_car(bundle: Bundle, settings: LowSpeedSettings) -> LowSpeedCar:
    """Numbers for the law below the model's speeds: of the settings, else of the model.

    Raises:
        ArtifactError: the model's encoder cannot be used.
    """
    hysteresis_mps = 1.0
    speeds = SpeedRange(settings.below_mps, settings.below_mps + hysteresis_mps)
    car, found = bundle.car or UNNAMED_CAR, identify_gains(bundle, speeds.resume_mps)
    gains = PedalGains(
        settings.throttle_mps2 or car.throttle_mps2 or found.throttle_mps2,
        settings.brake_mps2_per_n or car.brake_mps2_per_n or found.brake_mps2_per_n,
    )
    car = replace(
        car, **settings.model_dump(include={*SteeringGeometry._fields}, exclude_none=True)
    )
    hold_n = min(settings.hold_mps2 / gains.brake_mps2_per_n, car.limits.upper.brake_n)
    return LowSpeedCar(car, gains, speeds, hold_n, bundle.largest_steer_rad)


def plan_at_constant_speed(planner: Planner) -> None:
    """Plan several times at a constant speed, so that all code and data is loaded before tick 0.

    Raises:
        ConfigError: the QP of a constant speed on a straight path is not solved.
        ControlLawError: a law gives no input there.
    """
    state = AT_REST._replace(vx_mps=20.0, ds_m=20.0 * PERIOD_S)
    path = PathReference(0.0, 0.0, 0.0, 0.0, v_mps=20.0, a_mps2=0.0)
    for _ in range(20):
        x_0 = planner.observer.observe(state, NEUTRAL_INPUT)
        status = planner.plan(x_0, 0.0, path, NEUTRAL_INPUT)
    if status is not SolveStatus.SOLVED:
        raise law_error(planner) or ConfigError(
            f"The QP of a constant 20 m/s on a straight path: expected it to be solved, found "
            f"{status.name}. Check the model and `mpc.tolerance`."
        )


class ControlNode(NamedTuple):
    """The parts of one controller on one bus; a drive and its replay build the same."""

    inbox: Inbox
    outbox: Outbox
    step: ControlStep
    supervisor: Supervisor


def build_node(
    bus: can.BusABC,
    config: ControllerConfig,
    bundle: Bundle,
    planner: Planner,
    clock: TimeSource,
    recorder: Recorder | None = None,
    note_call: Callable[[str], None] = lambda name: None,
    checks: Sequence[Check] | None = None,
) -> ControlNode:
    """The parts, connected; nothing is sent yet.

    Args:
        bus: the open bus.
        config: settings.
        bundle: the model that the checks predict with.
        planner: of the inputs.
        clock: of the loop.
        recorder: of frames; None: they are not recorded.
        note_call: as of `ControlStep`.
        checks: of the supervisor; None: all, with the thresholds of the model's car.

    Raises:
        ArtifactError: the model's encoder cannot be used.
        ConfigError: the model's car has thresholds of quantities that do not exist.
    """
    inbox = Inbox(Node.CONTROLLER, recorder)
    outbox = Outbox(bus, Node.CONTROLLER, recorder)
    low_speed_car = choose_low_speed_car(bundle, config.low_speed)
    supervisor = Supervisor(
        MotionPrediction(bundle, bundle.n_observables),
        StoppingCar(
            low_speed_car.geometry,
            low_speed_car.gains.brake_mps2_per_n,
            low_speed_car.gains.throttle_mps2,
            max(low_speed_car.speeds.leave_mps, LEAST_MODELLED_MPS),
        ),
        checks_of(low_speed_car.car) if checks is None else checks,
        bundle.trained_range,
        config.mpc.actuation_delay,
    )
    step = ControlStep(
        bus=bus,
        inbox=inbox,
        outbox=outbox,
        planner=planner,
        low_speed=LowSpeedLaw(low_speed_car),
        car=low_speed_car.car,
        clock=clock,
        model_hash=model_hash(bundle.sha256),
        supervisor=supervisor,
        actuation_periods=config.mpc.actuation_delay,
        note_call=note_call,
    )
    return ControlNode(inbox, outbox, step, supervisor)
