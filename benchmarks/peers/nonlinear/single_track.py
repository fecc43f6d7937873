"""A single-track car on a curved road as CasADi sees it: five states, Magic-Formula tyres.

Rajamani, *Vehicle Dynamics and Control* (2012), chapter 2 (motion along a road); Pacejka, *Tyre
and Vehicle Dynamics* (2012), chapter 4. Its numbers are those of the rival `bicycle`, rounded,
which were fitted to the same data as the networks; lags, roll and relaxation are left out, as an
NMPC of a car usually does.
"""

import casadi as ca

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
GRAVITY_MPS2 = 9.81
LEAST_SPEED_MPS = 1.0


def rates(x: ca.SX, u: ca.SX, curvature_per_m: ca.SX) -> ca.SX:
    """d/dt of `STATES` (5,) under [throttle, brake in N, steering wheel in rad] (3,)."""
    vx, vy, yaw_rate, ey, epsi = (x[i] for i in range(len(STATES)))
    rolling = ca.fmax(vx, LEAST_SPEED_MPS)
    wheel = u[2] / STEERING_RATIO
    wheelbase = FRONT_M + REAR_M
    front = (GRAVITY_MPS2 * REAR_M / wheelbase) * _grip(
        wheel - (vy + FRONT_M * yaw_rate) / rolling, *FRONT
    )
    rear = (GRAVITY_MPS2 * FRONT_M / wheelbase) * _grip(-(vy - REAR_M * yaw_rate) / rolling, *REAR)
    # Power limits the drive at speed, grip and gearing below it; smooth in between.
    drive = DRIVE_MPS2 / ca.sqrt(1.0 + (rolling * DRIVE_MPS2 / POWER_W_PER_KG) ** 2)
    along = u[0] * drive - BRAKE_MPS2_PER_N * u[1] - ROLLING_MPS2 - DRAG_PER_M * vx**2
    progress = (vx * ca.cos(epsi) - vy * ca.sin(epsi)) / (1.0 - ey * curvature_per_m)
    return ca.vertcat(
        along - front * ca.sin(wheel) + yaw_rate * vy,
        front * ca.cos(wheel) + rear - yaw_rate * vx,
        (FRONT_M * front * ca.cos(wheel) - REAR_M * rear) / GYRATION_M2,
        vx * ca.sin(epsi) + vy * ca.cos(epsi),
        yaw_rate - curvature_per_m * progress,
    )


def one_period(x: ca.SX, u: ca.SX, curvature_per_m: ca.SX, period_s: float) -> ca.SX:
    """`STATES` one period on, by a Runge-Kutta step of fourth order."""
    a = rates(x, u, curvature_per_m)
    b = rates(x + 0.5 * period_s * a, u, curvature_per_m)
    c = rates(x + 0.5 * period_s * b, u, curvature_per_m)
    d = rates(x + period_s * c, u, curvature_per_m)
    return x + period_s / 6.0 * (a + 2.0 * b + 2.0 * c + d)


def _grip(slip: ca.SX, stiffness: float, friction: float, shape: float, curvature: float) -> ca.SX:
    """Side force in units of the axle's load."""
    reach = stiffness / (friction * shape) * slip
    bent = (1.0 - curvature) * reach + curvature * ca.atan(reach)
    return friction * ca.sin(shape * ca.atan(bent))
