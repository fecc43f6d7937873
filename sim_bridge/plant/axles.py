"""Parameters of the front and the rear axle in one form, so that both use the same equations."""

from typing import NamedTuple

from rt_controller.contract.physics import GRAVITY_MPS2
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import Parameters


class Axle(NamedTuple):
    """One axle; lengths forward of a centre of gravity are negative for the rear axle."""

    ahead_m: float
    """forward of the centre of gravity of the whole car"""
    sprung_ahead_m: float
    """forward of the centre of gravity of the sprung mass"""
    half_track_m: float
    track_m: float
    wheel_kg: float
    rest_load_n: float
    """load of one tyre of the car at rest"""
    spring_npm: float
    bar_nmprad: float
    jounce_nspm: float
    rebound_nspm: float
    jounce_fast_nspm: float
    rebound_fast_nspm: float
    damper_knee_mps: float
    stop_gap_m: float
    stop_npm2: float
    roll_centre_m: float
    arm_slope: float
    """upward force of the arms on the body per forward force at the road"""
    centre_slope: float
    """the same per forward force at the wheel centre"""
    roll_steer: float
    lateral_steer_radpn: float
    aligning_steer_radpnm: float
    camber_gain: float
    brake_nm_per_mpa: float


@compiled
def axles(p: Parameters) -> tuple[Axle, Axle]:
    """The front and the rear axle of the car."""
    body, suspension = p.body, p.suspension
    wheelbase_m = body.sprung_front_axle_m + body.sprung_rear_axle_m
    sprung_front_kg = body.sprung_mass_kg * body.sprung_rear_axle_m / wheelbase_m
    sprung_rear_kg = body.sprung_mass_kg - sprung_front_kg
    front = Axle(
        body.front_axle_m,
        body.sprung_front_axle_m,
        0.5 * body.track_front_m,
        body.track_front_m,
        0.5 * body.unsprung_front_kg,
        0.5 * GRAVITY_MPS2 * (sprung_front_kg + body.unsprung_front_kg),
        suspension.spring_front_npm,
        suspension.bar_front_nmprad,
        suspension.jounce_front_nspm,
        suspension.rebound_front_nspm,
        suspension.jounce_front_fast_nspm,
        suspension.rebound_front_fast_nspm,
        suspension.damper_knee_front_mps,
        suspension.stop_gap_front_m,
        suspension.stop_front_npm2,
        suspension.roll_centre_front_m,
        -suspension.arm_slope_front,
        -suspension.centre_slope_front,
        suspension.roll_steer_front,
        suspension.lateral_steer_front_radpn,
        suspension.aligning_steer_front_radpnm,
        suspension.camber_gain_front,
        p.brakes.front_nm_per_mpa,
    )
    rear = Axle(
        -body.rear_axle_m,
        -body.sprung_rear_axle_m,
        0.5 * body.track_rear_m,
        body.track_rear_m,
        0.5 * body.unsprung_rear_kg,
        0.5 * GRAVITY_MPS2 * (sprung_rear_kg + body.unsprung_rear_kg),
        suspension.spring_rear_npm,
        suspension.bar_rear_nmprad,
        suspension.jounce_rear_nspm,
        suspension.rebound_rear_nspm,
        suspension.jounce_rear_fast_nspm,
        suspension.rebound_rear_fast_nspm,
        suspension.damper_knee_rear_mps,
        suspension.stop_gap_rear_m,
        suspension.stop_rear_npm2,
        suspension.roll_centre_rear_m,
        suspension.arm_slope_rear,
        suspension.centre_slope_rear,
        suspension.roll_steer_rear,
        suspension.lateral_steer_rear_radpn,
        suspension.aligning_steer_rear_radpnm,
        suspension.camber_gain_rear,
        p.brakes.rear_nm_per_mpa,
    )
    return front, rear
