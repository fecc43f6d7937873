"""From a model bundle to a controller that plans with it; needs no bus."""

from functools import partial

from rt_controller.bundle_checks.plan_check import require_stored_plans
from rt_controller.config import LowSpeedSettings, MpcSettings
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.validation import require_drivable
from rt_controller.contract.signals import AT_REST, NEUTRAL_INPUT, PathReference
from rt_controller.contract.steering_geometry import UNNAMED_GEOMETRY, SteeringGeometry
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.low_speed.handover import SpeedRange
from rt_controller.control.low_speed.identification import identify_gains
from rt_controller.control.low_speed.law import LowSpeedCar
from rt_controller.control.low_speed.speed import PedalGains
from rt_controller.control.mpc import Mpc
from rt_controller.control.qp import Features
from rt_controller.control.solver import SolveStatus, open_solver
from rt_controller.control.terms import Corridor

WARM_UP_STEPS = 20
RESUME_ABOVE_MPS = 1.0
"""hysteresis between the low-speed law and the model"""


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
        Features(corridor=corridor),
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
    speeds = SpeedRange(settings.below_mps, settings.below_mps + RESUME_ABOVE_MPS)
    found = identify_gains(bundle, speeds.resume_mps)
    gains = PedalGains(
        _first(settings.throttle_mps2, found.throttle_mps2),
        _first(settings.brake_mps2_per_n, found.brake_mps2_per_n),
    )
    own = bundle.geometry or UNNAMED_GEOMETRY
    geometry = SteeringGeometry(
        _first(settings.wheelbase_m, own.wheelbase_m),
        _first(settings.rear_axle_m, own.rear_axle_m),
        _first(settings.steering_ratio, own.steering_ratio),
        _first(settings.lock_rad, own.lock_rad),
    )
    hold_n = min(settings.hold_mps2 / gains.brake_mps2_per_n, INPUT_LIMITS.upper.brake_n)
    return LowSpeedCar(geometry, gains, speeds, hold_n, bundle.largest_steer_rad)


def _first(chosen: float | None, otherwise: float) -> float:
    return otherwise if chosen is None else chosen


def plan_at_constant_speed(mpc: Mpc) -> None:
    """Plan several times at a constant speed, so that all code and data is loaded before tick 0.

    Raises:
        ConfigError: the QP of a constant speed on a straight path is not solved.
    """
    state = AT_REST._replace(vx_mps=20.0, ds_m=20.0 * PERIOD_S)
    path = PathReference(0.0, 0.0, 0.0, 0.0, v_mps=20.0, a_mps2=0.0)
    for _ in range(WARM_UP_STEPS):
        status = mpc.plan(state, 0.0, path, NEUTRAL_INPUT)
    if status is not SolveStatus.SOLVED:
        raise ConfigError(
            f"The QP of a constant 20 m/s on a straight path: expected it to be solved, found "
            f"{status.name}. Check the model and `mpc.tolerance`."
        )
