"""Eq. (14) with a nonlinear vehicle model, with the states as variables and without them.

The vehicle is a single track on a curved road: five states, Magic-Formula tyres. Rajamani, *Vehicle
Dynamics and Control* (2012), chapter 2 (motion along a road); Pacejka, *Tyre and Vehicle Dynamics*
(2012), chapter 4. The parameters are those of the baseline `bicycle`, rounded, fitted to the same
data as the networks. Lags, roll and relaxation are left out, as usual in nonlinear MPC.
"""

from typing import NamedTuple

import casadi as ca
import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.physics import GRAVITY_MPS2
from rt_controller.contract.schema import N_INPUTS
from rt_controller.contract.signals import VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.knots import place_knots
from rt_controller.control.terms import TrackingCost, constrain_inputs

STATES = ("vx_mps", "vy_mps", "yaw_rate_radps", "ey_m", "epsi_rad")

FRONT_M, REAR_M = 0.92, 1.92
GYRATION_M2 = 1.304
STEERING_RATIO = 19.2
FRONT = (19.1, 0.79, 0.985, -0.79)
REAR = (16.2, 1.03, 0.944, -0.46)
"""cornering stiffness per load, friction, shape and curvature of the Magic Formula"""
DRIVE_MPS2, POWER_W_PER_KG = 4.5, 48.0
BRAKE_MPS2_PER_N = 0.055
ROLLING_MPS2, DRAG_PER_M = 0.25, 2.3e-4
MIN_SPEED_MPS = 1.0


def rates(x: ca.SX, u: ca.SX, curvature_per_m: ca.SX) -> ca.SX:
    """d/dt of `STATES` (5,) under [throttle, brake in N, steering wheel in rad] (3,)."""
    vx, vy, yaw_rate, ey, epsi = (x[i] for i in range(len(STATES)))
    speed = ca.fmax(vx, MIN_SPEED_MPS)
    wheel = u[2] / STEERING_RATIO
    wheelbase = FRONT_M + REAR_M
    front = (GRAVITY_MPS2 * REAR_M / wheelbase) * _grip(
        wheel - (vy + FRONT_M * yaw_rate) / speed, *FRONT
    )
    rear = (GRAVITY_MPS2 * FRONT_M / wheelbase) * _grip(-(vy - REAR_M * yaw_rate) / speed, *REAR)
    # Power limits the drive at speed, grip and gearing below it; smooth in between.
    drive = DRIVE_MPS2 / ca.sqrt(1.0 + (speed * DRIVE_MPS2 / POWER_W_PER_KG) ** 2)
    traction = u[0] * drive - BRAKE_MPS2_PER_N * u[1] - ROLLING_MPS2 - DRAG_PER_M * vx**2
    progress = (vx * ca.cos(epsi) - vy * ca.sin(epsi)) / (1.0 - ey * curvature_per_m)
    return ca.vertcat(
        traction - front * ca.sin(wheel) + yaw_rate * vy,
        front * ca.cos(wheel) + rear - yaw_rate * vx,
        (FRONT_M * front * ca.cos(wheel) - REAR_M * rear) / GYRATION_M2,
        vx * ca.sin(epsi) + vy * ca.cos(epsi),
        yaw_rate - curvature_per_m * progress,
    )


def one_period(x: ca.SX, u: ca.SX, curvature_per_m: ca.SX, period_s: float) -> ca.SX:
    """`STATES` after one period, by a Runge-Kutta step of fourth order."""
    a = rates(x, u, curvature_per_m)
    b = rates(x + 0.5 * period_s * a, u, curvature_per_m)
    c = rates(x + 0.5 * period_s * b, u, curvature_per_m)
    d = rates(x + period_s * c, u, curvature_per_m)
    return x + period_s / 6.0 * (a + 2.0 * b + 2.0 * c + d)


def _grip(slip: ca.SX, stiffness: float, friction: float, shape: float, curvature: float) -> ca.SX:
    """Side force in units of the axle's load."""
    B_slip = stiffness / (friction * shape) * slip
    argument = (1.0 - curvature) * B_slip + curvature * ca.atan(B_slip)
    return friction * ca.sin(shape * ca.atan(argument))


N_MOTION = len(STATES)
TRACKED = [VehicleState._fields.index(name) for name in STATES]
"""columns of a reference; Delta s is omitted, since with this model it follows from v_x"""


class NmpcParameters(NamedTuple):
    """What changes from one period to the next. Inputs are in units of their ranges."""

    motion: Array
    """(5,) `STATES`"""
    previous: Array
    """(3,) the input of the last period"""
    upper: Array
    """(N, 3) upper bounds of the inputs, with the pedal that may not be pressed"""
    reference: Array
    """(N, 5) `STATES` of stages 1 … N"""
    curvature_per_m: float


class Weights(NamedTuple):
    """Weights of the squares in the cost, each halved: (N, 5), (3,) and (3,)."""

    motion: Array
    inputs: Array
    changes: Array


def weights_of(cost: TrackingCost, horizon: int, scale: Array) -> Weights:
    """The controller's own cost. `scale` (3,) are the ranges of the inputs."""
    stage = 1.0 / np.square(np.array(cost.state)[TRACKED])
    motion = np.tile(stage, (horizon, 1))
    motion[-1] *= cost.terminal_factor
    return Weights(
        motion,
        np.square(scale / np.array(cost.control)),
        np.square(scale / np.array(cost.control_change)),
    )


def period_function(scale: Array) -> ca.Function:
    """(x, v, kappa) -> x after one period, a function that every stage calls."""
    x, v, kappa = ca.SX.sym("x", N_MOTION), ca.SX.sym("v", N_INPUTS), ca.SX.sym("kappa")
    return ca.Function("period", [x, v, kappa], [one_period(x, v * ca.DM(scale), kappa, PERIOD_S)])


def hessian_function(functions: dict[str, ca.MX], hessian: ca.MX) -> ca.Function:
    """`hessian` of the cost under the names that CasADi gives the Hessian of a Lagrangian."""
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", functions["g"].shape[0])
    return ca.Function(
        "gauss_newton",
        [functions["x"], functions["p"], lam_f, lam_g],
        [lam_f * hessian],
        ["x", "p", "lam_f", "lam_g"],
        ["hess_gamma_x_x"],
    )


class Condensed:
    """Single shooting over z = [v_0, …, v_(N-1)]: g are the changes of the inputs.

    p = [kappa; x_0; v_-1; x_r of stages 1 … N]. `functions` are x, p, f and g as CasADi's solvers
    take them, `hessian` is the Gauss-Newton Hessian: exact but for the curvature of the vehicle
    model. No array moves: solvers keep pointers to them.
    """

    def __init__(self, horizon: int, cost: TrackingCost) -> None:
        bounds = constrain_inputs(place_knots(horizon, horizon))
        self._scale = bounds.scale[:N_INPUTS]
        weights = weights_of(cost, horizon, self._scale)
        period = period_function(self._scale)
        z = ca.MX.sym("z", horizon * N_INPUTS)
        kappa, start = ca.MX.sym("kappa"), ca.MX.sym("x", N_MOTION)
        v_prev, x_r = ca.MX.sym("v_prev", N_INPUTS), ca.MX.sym("x_r", horizon * N_MOTION)
        x, motion = start, []
        for k in range(horizon):
            x = period(x, z[k * N_INPUTS : (k + 1) * N_INPUTS], kappa)
            motion.append(x)
        changes = z - ca.vertcat(v_prev, z[:-N_INPUTS])
        sqrt_q = np.sqrt(weights.motion).reshape(-1)
        weighted = np.flatnonzero(sqrt_q).tolist()
        deviation = (ca.DM(sqrt_q) * (ca.vertcat(*motion) - x_r))[weighted]
        on_inputs = ca.DM(np.tile(weights.inputs, horizon))
        on_changes = ca.DM(np.tile(weights.changes, horizon))
        direct = 0.5 * ca.dot(on_inputs, z**2) + 0.5 * ca.dot(on_changes, changes**2)
        J = ca.jacobian(deviation, z)
        parts = [kappa, start, v_prev, x_r]
        p = ca.MX.sym("p", sum(part.numel() for part in parts))
        splits = np.cumsum([0, *(part.numel() for part in parts)]).tolist()
        f, g, hessian = ca.substitute(
            [0.5 * ca.sumsqr(deviation) + direct, changes, J.T @ J + ca.hessian(direct, z)[0]],
            parts,
            ca.vertsplit(p, splits),
        )
        self.functions = {"x": z, "p": p, "f": f, "g": g}
        self.hessian = hessian_function(self.functions, hessian)
        self.z, self.parameters = np.zeros(z.numel()), np.zeros(p.numel())
        self.lower, self.upper = bounds.lower, bounds.upper
        self.row_lower, self.row_upper = -bounds.slew, bounds.slew

    def update_vectors(self, parameters: NmpcParameters) -> None:
        """Update bounds and parameters, and shift the last solution z by one period."""
        motion, previous, upper, reference, curvature_per_m = parameters
        self.z[:-N_INPUTS] = self.z[N_INPUTS:]
        self.upper[:] = upper.reshape(-1)
        np.concatenate(
            [[curvature_per_m], motion, previous, reference.reshape(-1)], out=self.parameters
        )

    def read_inputs(self, inputs: Array) -> None:
        """Write the plan in z into `inputs` (N, 3), in physical units."""
        np.multiply(self.z.reshape(-1, N_INPUTS), self._scale, out=inputs)


N_STAGE = N_MOTION + N_INPUTS
N_BLOCK = N_STAGE + N_INPUTS
"""a stage and its control"""


class Stagewise:
    """Multiple shooting, for solvers that use the stages; attributes as `Condensed`.

    z = [x_0, v_-1, dv_0, x_1, v_0, dv_1, …, x_N, v_(N-1)]: a stage carries the input in force, its
    control is the change, so limits of both are bounds on single variables. g are the gaps between
    stages, p = [kappa; x_r of stages 1 … N].
    """

    def __init__(self, horizon: int, cost: TrackingCost) -> None:
        self._horizon = horizon
        bounds = constrain_inputs(place_knots(1, 1))
        self._scale = bounds.scale
        weights = weights_of(cost, horizon, bounds.scale)
        period = period_function(bounds.scale)
        z = ca.MX.sym("z", horizon * N_BLOCK + N_STAGE)
        p = ca.MX.sym("p", 1 + horizon * N_MOTION)
        gaps, f = [], ca.MX(0)
        for k in range(horizon):
            stage = z[k * N_BLOCK : (k + 1) * N_BLOCK]
            following = z[(k + 1) * N_BLOCK : (k + 1) * N_BLOCK + N_STAGE]
            x, change = stage[:N_MOTION], stage[N_STAGE:]
            v = stage[N_MOTION:N_STAGE] + change
            gaps += [period(x, v, p[0]) - following[:N_MOTION], v - following[N_MOTION:]]
            deviation = following[:N_MOTION] - p[1 + k * N_MOTION : 1 + (k + 1) * N_MOTION]
            f += 0.5 * ca.dot(ca.DM(weights.motion[k]), deviation**2)
            f += 0.5 * ca.dot(ca.DM(weights.inputs), following[N_MOTION:] ** 2)
            f += 0.5 * ca.dot(ca.DM(weights.changes), change**2)
        self.functions = {"x": z, "p": p, "f": f, "g": ca.vertcat(*gaps)}
        self.hessian = hessian_function(self.functions, ca.hessian(f, z)[0])

        size, rows = z.numel(), horizon * N_STAGE
        free = np.full(N_MOTION, np.inf)
        self.z, self.parameters = np.zeros(size), np.zeros(p.numel())
        lower = np.concatenate([-free, bounds.lower, -bounds.slew])
        upper = np.concatenate([free, bounds.upper, bounds.slew])
        self.lower = np.tile(lower, horizon + 1)[:size]
        self.upper = np.tile(upper, horizon + 1)[:size]
        self.row_lower, self.row_upper = np.zeros(rows), np.zeros(rows)

    def update_vectors(self, parameters: NmpcParameters) -> None:
        """As `Condensed.update_vectors`."""
        self.z[:-N_BLOCK] = self.z[N_BLOCK:]
        start = np.concatenate([parameters.motion, parameters.previous])
        self.z[:N_STAGE] = self.lower[:N_STAGE] = self.upper[:N_STAGE] = start
        self._inputs_of(self.upper)[:] = parameters.upper
        self.parameters[0] = parameters.curvature_per_m
        self.parameters[1:] = parameters.reference.reshape(-1)

    def read_inputs(self, inputs: Array) -> None:
        """As `Condensed.read_inputs`."""
        np.multiply(self._inputs_of(self.z), self._scale, out=inputs)

    def _inputs_of(self, z: Array) -> Array:
        """(N, 3), a view of v_0 … v_(N-1)."""
        return z[N_STAGE:].reshape(self._horizon, N_BLOCK)[:, -N_INPUTS:]


NonlinearProgram = Condensed | Stagewise
