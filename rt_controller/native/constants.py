"""The constants of a control law in C: of a model, its optimal control problem and limits."""

from types import SimpleNamespace

import numpy as np

from rt_controller.config import MpcSettings
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
from rt_controller.control import estimator, pedals, steering_factor
from rt_controller.control.eq14 import RELEASED, SLOWEST_MPS, CondensedQp
from rt_controller.control.mpc import MOST_NOMINAL_THROTTLE
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Step
from rt_controller.native.network import Network, network_of

MIRROR_SIGNS = VehicleState(1.0, -1.0, -1.0, 1.0, -1.0, -1.0)
"""of the states when left and right are exchanged"""
ITERATIONS_OF_INPUT = 4
"""iterations of the QP for each number of v, at most; recorded plans need 45 in all, and random
situations up to 3.6 a number"""


class Struct(SimpleNamespace):
    """A struct of `c/mdk.h`: its fields by their names, in their order.

    A tuple is an array inside the struct, a numpy array is behind a pointer.
    """


def constants_of(bundle: Bundle, settings: MpcSettings) -> Struct:
    """`mdk_model` of the MPC with this model and these settings.

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
    return Struct(
        period_s=PERIOD_S,
        encoder=network,
        dynamics=_dynamics(bundle, network),
        problem=_problem(qp),
        estimation=Struct(
            gain=tuple(estimator.GAIN),
            offset_gain=tuple(estimator.OFFSET_GAIN),
            kept=tuple(estimator.KEPT.tolist()),
            low_pass=tuple(estimator.low_pass(settings.disturbance_gain)),
            largest=tuple(estimator.LARGEST_DISTURBANCE.tolist()),
            moved_pedal=estimator.MOVED,
            brake_n=INPUT_LIMITS.upper.brake_n,
            fast_mps=estimator.FAST_MPS,
            smallest_factor=steering_factor.SMALLEST,
            largest_factor=steering_factor.LARGEST,
            information=steering_factor.information(settings.disturbance_gain),
            least_radps=steering_factor.LEAST_RADPS,
            averaged=steering_factor.AVERAGED,
            at_rate_rad=steering_factor.AT_RATE_RAD,
        ),
        envelope=Struct(
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


def _dynamics(bundle: Bundle, network: Network) -> Struct:
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
        gains = np.vstack([S, step.N.T])
        mixed = np.any(gains[:, is_odd], axis=1) & np.any(gains[:, ~is_odd], axis=1)
        if step.A[is_odd[:, None] != is_odd].any() or mixed.any():
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
    return Struct(
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


def _problem(qp: CondensedQp) -> Struct:
    columns, R = qp.columns, qp.R
    return Struct(
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
