"""One wheel on the road: its velocity, slips, force and spin."""

from math import cos, sin
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from sim_bridge.plant import body, brakes, steering, suspension
from sim_bridge.plant.axles import Axle
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.states import AT, N_FRONT, N_STATES
from sim_bridge.plant.suspension import LEFT
from sim_bridge.plant.tyre import magic_formula, tyres

LARGEST_STEP_S = 0.001
"""of the integration; the spin of a light wheel against the damping of its tyre is the fastest"""
_LARGEST_DAMPING_OF_A_STEP = 1.8
"""rate times step; at 2 the midpoint rule becomes unstable"""


class Derivative(NamedTuple):
    """Derivative of a state: x' = rate - decay x, and dry friction of size `friction` against x.

    Three arrays of `N_STATES` entries each.
    """

    rate: Array
    decay: Array
    friction: Array


@compiled
def new_derivative() -> Derivative:
    """A derivative of zeros, for `evaluate` to write to."""
    return Derivative(np.zeros(N_STATES), np.zeros(N_STATES), np.zeros(N_STATES))


class WheelForce(NamedTuple):
    """Force of the road on one wheel in body axes, its moments around the vertical, its speed."""

    forward_n: float
    left_n: float
    aligning_nm: float
    kingpin_nm: float
    side_n: float
    """force to the left in the axes of the wheel"""
    forward_mps: float
    """speed of the wheel's centre along the wheel"""


@compiled
def wheel_force(
    state: Array,
    wheel: int,
    axle: Axle,
    angle_rad: float,
    drive_nm: float,
    p: Parameters,
    out: Derivative,
) -> WheelForce:
    """Force of the road on one wheel in body axes; its slips and spin go into `out`.

    Args:
        angle_rad: of the wheel against the body, positive to the left.
    """
    side = suspension.side_of(wheel)
    load_n = suspension.tyre_load_n(state, wheel, axle, p.tyre)
    road_friction = p.road.friction_left if side == LEFT else p.road.friction_right
    forward_mps, left_mps = _velocity(state, side, axle, angle_rad, p)
    # The wheels follow the roll of the body only in part; travel compensates the rest.
    lean_per_m = side * 2.0 * (1.0 - axle.camber_gain) / axle.track_m
    lean_rad = state[AT.roll_rad] + lean_per_m * suspension.travel_m(state, wheel, axle)
    spin = state[AT.spin_radps + wheel]
    lateral_slip = state[AT.lateral_slip + wheel]
    longitudinal_slip = state[AT.longitudinal_slip + wheel]
    radius_m = p.tyre.rolling_radius_m
    across = tyres.lateral_relaxation(lateral_slip, forward_mps, left_mps, load_n, p.tyre)
    along = tyres.longitudinal_relaxation(
        longitudinal_slip, forward_mps, spin * radius_m, load_n, p.tyre
    )
    sideways = lateral_slip + across.damping
    forward_slip = longitudinal_slip + along.damping * longitudinal_damping_share(p)
    if p.tyre_file.fnomin > 0.0:
        # A file is of a tyre of one side; the car has its mirror image on the other side.
        mirror = -side if p.tyre_file.is_right > 0.0 else side
        road = magic_formula.force(
            sideways, forward_slip, lean_rad, load_n, road_friction, mirror, p.tyre_file
        )
    else:
        road = tyres.force(sideways, forward_slip, lean_rad, load_n, road_friction, p.tyre)
    out.rate[AT.lateral_slip + wheel] = across.rate
    out.decay[AT.lateral_slip + wheel] = across.decay
    out.rate[AT.longitudinal_slip + wheel] = along.rate
    out.decay[AT.longitudinal_slip + wheel] = along.decay
    out.rate[AT.spin_radps + wheel] = (
        drive_nm - radius_m * road.forward_n
    ) / p.tyre.spin_inertia_kgm2
    release = state[AT.brake_release + wheel]
    if wheel >= N_FRONT:
        # The rear wheels get the pressure of the more slippery side, so that the axle guides.
        kept_release = max(state[AT.brake_release + 2], state[AT.brake_release + 3])
    else:
        kept_release = release
    out.rate[AT.brake_release + wheel] = brakes.release_per_s(
        forward_mps, spin * radius_m, release, p.anti_lock
    )
    out.friction[AT.spin_radps + wheel] = (
        axle.brake_nm_per_mpa * max(0.0, state[AT.brake_mpa + wheel]) * (1.0 - kept_release)
        + tyres.rolling_resistance_nm(spin, load_n, p.tyre)
    ) / p.tyre.spin_inertia_kgm2
    c, s = cos(angle_rad), sin(angle_rad)
    return WheelForce(
        c * road.forward_n - s * road.left_n,
        s * road.forward_n + c * road.left_n,
        road.aligning_nm,
        steering.kingpin_nm(road.aligning_nm, road.left_n, p.steering),
        road.left_n,
        forward_mps,
    )


@compiled
def longitudinal_damping_share(p: Parameters) -> float:
    """Share of the longitudinal damping of the tyres with which an integration step is stable.

    It is 1 for the shipped cars. Light wheels and stiff tyres, as in some `.tir` files, would
    oscillate at rest with the whole damping.
    """
    tyre = p.tyre
    stiffness = tyre.slip_stiffness
    if p.tyre_file.fnomin > 0.0:
        stiffness = p.tyre_file.pkx1 * p.tyre_file.lkx
    stiffness_npm = stiffness * tyre.relaxation_load_n / tyre.longitudinal_relaxation_m
    wheel_kg = tyre.spin_inertia_kgm2 / (tyre.rolling_radius_m * tyre.rolling_radius_m)
    damping = tyre.longitudinal_damping_s * stiffness_npm / wheel_kg * LARGEST_STEP_S
    return _LARGEST_DAMPING_OF_A_STEP / max(_LARGEST_DAMPING_OF_A_STEP, damping)


@compiled
def _velocity(
    state: Array, side: float, axle: Axle, angle_rad: float, p: Parameters
) -> tuple[float, float]:
    """Velocity of a wheel's contact in the axes of the wheel: forward and left, m/s."""
    yaw_rate = state[AT.yaw_rate_radps]
    frame_forward_mps, frame_left_mps = body.running_gear_velocity(
        state[AT.vx_mps], state[AT.vy_mps], state[AT.roll_rate_radps], state[AT.pitch_rate_radps],
        p.body, p.suspension,
    )  # fmt: skip
    contact_forward_mps = frame_forward_mps - side * axle.half_track_m * yaw_rate
    contact_left_mps = frame_left_mps + axle.ahead_m * yaw_rate
    c, s = cos(angle_rad), sin(angle_rad)
    return (
        c * contact_forward_mps + s * contact_left_mps,
        c * contact_left_mps - s * contact_forward_mps,
    )
