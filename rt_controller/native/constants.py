"""The constants of a control law in C: those of a model, of its optimal control problem and limits.

The named tuples are the structs of `c/mdk.h`, their fields in their order.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.config import MpcSettings
from rt_controller.contract.arrays import Array
from rt_controller.contract.car import UNNAMED_CAR
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import (
    INPUT_LIMITS,
    RELEASED_BRAKE_N,
    RELEASED_THROTTLE,
    UNDERSTEER_RAD_PER_MPS2,
)
from rt_controller.contract.signals import (
    N_INPUTS,
    N_STATES,
    PATH_STATES,
    StateColumn,
    VehicleState,
)
from rt_controller.contract.timing import HOLD_PLAN_TICKS, PERIOD_S
from rt_controller.control import estimator, pedals
from rt_controller.control.eq14 import RELEASED, SLOWEST_MPS, CondensedQp
from rt_controller.control.mpc import MOST_NOMINAL_THROTTLE
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Step
from rt_controller.native.network import Network, network_of

Whole = NDArray[np.int32]
Flags = NDArray[np.bool_]
MIRROR_SIGNS = VehicleState(1.0, -1.0, -1.0, 1.0, -1.0, -1.0)
"""of the states when left and right are exchanged"""
ITERATIONS_OF_INPUT = 4
"""iterations of the QP for each number of v, at most; recorded plans need 45 in all, and random
situations up to 3.6 a number"""


class DynamicsConstants(NamedTuple):
    """As `mdk_dynamics`."""

    n: int
    m: int
    even: int
    gains: int
    parts: tuple[int, ...]
    place: Whole
    A: Array
    B: Array
    c: Array
    N: Array
    S: Array
    s0: Array
    is_odd: Flags
    is_linear: Flags
    factor: Whole
    has_path: bool


class ProblemConstants(NamedTuple):
    """As `mdk_problem`."""

    horizon: int
    knots: int
    stages: Whole
    tracked: int
    columns: Whole
    ey: int
    vx: int
    has_course: bool
    Q: Array
    R: Array
    R_next: Array
    from_previous: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    slew: tuple[float, ...]
    range: tuple[float, ...]
    pedal_change: int
    change_mps2: float
    released: float
    most_nominal_throttle: float
    slowest_mps: float
    max_iterations: int


class EstimationConstants(NamedTuple):
    """As `mdk_estimation`."""

    gain: tuple[float, ...]
    offset_gain: tuple[float, ...]
    kept: tuple[float, ...]
    low_pass: tuple[float, ...]
    largest: tuple[float, ...]
    moved_pedal: float
    brake_n: float


class EnvelopeConstants(NamedTuple):
    """As `mdk_envelope`."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    change: tuple[float, ...]
    released: tuple[float, ...]
    steering_ratio: float
    wheelbase_m: float
    understeer: float
    plan_mps2: float
    accepted_mps2: float
    least_rad: float
    lock_rad: float
    trained_rad: float


class LawConstants(NamedTuple):
    """As `mdk_model`."""

    period_s: float
    encoder: Network
    dynamics: DynamicsConstants
    problem: ProblemConstants
    estimation: EstimationConstants
    envelope: EnvelopeConstants
    hold_periods: int


def constants_of(bundle: Bundle, settings: MpcSettings) -> LawConstants:
    """The constants of the MPC with this model and these settings.

    Raises:
        ArtifactError: the encoder is not a network of offline-train.
        ConfigError: the settings have a cost that the C code does not know.
    """
    settings = settings.for_model(bundle)
    for name, is_known in (
        ("mpc.corridor-m", settings.corridor_m is None),
        ("mpc.tolerance.ds-m", bundle.movement is None or np.isinf(settings.tolerance.ds_m)),
    ):
        if not is_known:
            raise ConfigError(
                f"{name}: expected none with the control law in C, found one. Leave it out, or "
                f"drive with the law in Python."
            )
    car = bundle.car or UNNAMED_CAR
    limits, network = car.limits, network_of(bundle)
    qp = CondensedQp(bundle, settings.horizon, settings.cost(), None, settings.knots)
    return LawConstants(
        period_s=PERIOD_S,
        encoder=network,
        dynamics=_dynamics(bundle, network),
        problem=_problem(qp),
        estimation=EstimationConstants(
            gain=tuple(estimator.GAIN),
            offset_gain=tuple(estimator.OFFSET_GAIN),
            kept=tuple(estimator.KEPT.tolist()),
            low_pass=tuple(estimator.low_pass(settings.disturbance_gain)),
            largest=tuple(estimator.LARGEST_DISTURBANCE.tolist()),
            moved_pedal=estimator.MOVED,
            brake_n=INPUT_LIMITS.upper.brake_n,
        ),
        envelope=EnvelopeConstants(
            lower=tuple(limits.lower),
            upper=tuple(limits.upper),
            change=tuple(rate * PERIOD_S for rate in limits.rate_per_s),
            released=(RELEASED_THROTTLE, RELEASED_BRAKE_N),
            steering_ratio=car.steering_ratio,
            wheelbase_m=car.wheelbase_m,
            understeer=UNDERSTEER_RAD_PER_MPS2,
            plan_mps2=car.plan_lateral_mps2,
            accepted_mps2=car.accepted_mps2,
            least_rad=INPUT_LIMITS.upper.steer_rad,
            lock_rad=car.lock_rad,
            trained_rad=bundle.largest_steer_rad,
        ),
        hold_periods=HOLD_PLAN_TICKS,
    )


def _dynamics(bundle: Bundle, network: Network) -> DynamicsConstants:
    step, movement, n = Step(bundle), bundle.movement, bundle.n_observables
    S, s0 = step.S, step.s0
    if movement is not None:
        S, s0 = np.vstack([S, movement.S]), np.append(s0, movement.s0)
    of_A = np.ones(n, dtype=bool)
    of_A[PATH_STATES] = movement is None
    is_odd = np.zeros(n, dtype=bool)
    if network.latent_signs is not None:
        is_odd[:N_STATES] = np.array(MIRROR_SIGNS) < 0.0
        is_odd[N_STATES:] = network.latent_signs < 0.0
        if step.A[np.ix_(is_odd, ~is_odd)].any() or step.A[np.ix_(~is_odd, is_odd)].any():
            is_odd[:] = False  # matrices of another origin
    order = np.lexsort((is_odd, ~of_A))
    m, even = int(of_A.sum()), int(np.sum(of_A & ~is_odd))
    rows_are_odd = np.any(S[:, of_A & is_odd], axis=1)
    # Gains of even observables first; of each kind those whose function is even.
    acts_on_odd = np.any(step.N[of_A & is_odd], axis=0)
    kind = 2 * acts_on_odd + rows_are_odd[: step.count]
    gains = np.argsort(kind, kind="stable")
    rows = np.append(gains, np.arange(step.count, len(S)))
    order_of_A = order[:m]
    return DynamicsConstants(
        n=n,
        m=m,
        even=even,
        gains=step.count,
        parts=(0, *np.cumsum(np.bincount(kind, minlength=4)).tolist()),
        place=np.argsort(order).astype(np.int32),
        A=step.A[np.ix_(order_of_A, order_of_A)],
        B=step.B[order_of_A, : N_INPUTS + 1],
        c=step.c[order_of_A],
        N=step.N[np.ix_(order_of_A, gains)],
        S=S[np.ix_(rows, order_of_A)],
        s0=s0[rows],
        is_odd=rows_are_odd[rows],
        is_linear=gains < step.first_saturating,
        factor=step.factors[gains].astype(np.int32),
        has_path=movement is not None,
    )


def _problem(qp: CondensedQp) -> ProblemConstants:
    columns, R = qp.columns, qp.R
    return ProblemConstants(
        horizon=qp.knots.horizon,
        knots=qp.knots.count,
        stages=np.array(qp.knots.stages, dtype=np.int32),
        tracked=len(columns),
        columns=np.array(columns, dtype=np.int32),
        ey=columns.index(StateColumn.ey_m),
        vx=columns.index(StateColumn.vx_mps) if StateColumn.vx_mps in columns else -1,
        has_course=qp.has_course,
        Q=qp.Q,
        R=R.diagonal(),  # the changes of an input couple neighbouring knots only
        R_next=R.diagonal(-N_INPUTS),
        from_previous=tuple(qp.from_previous.tolist()),
        lower=tuple(qp.v_min.tolist()),
        upper=tuple(qp.v_max.tolist()),
        slew=tuple(qp.slew.tolist()),
        range=tuple(qp.range.tolist()),
        pedal_change=pedals.CHANGE_TICKS,
        change_mps2=pedals.CHANGE_MPS2,
        released=RELEASED,
        most_nominal_throttle=MOST_NOMINAL_THROTTLE,
        slowest_mps=SLOWEST_MPS,
        max_iterations=ITERATIONS_OF_INPUT * qp.scale.size,
    )
