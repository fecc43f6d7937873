"""The car's state vector: which number stands where.

A state is a flat float64 array of `N_STATES` entries; code reaches into it by name through `AT`,
never by number. Wheels are always ordered front left, front right, rear left, rear right; an
entry that exists once per wheel names the first of four neighbours.
Axes: x forward, y left, z up; positive roll lowers the right side, positive pitch the nose.
"""

from typing import NamedTuple


class StateIndex(NamedTuple):
    """Positions in the state vector."""

    vx_mps: int
    """velocity of the centre of gravity of the whole car, body axes"""
    vy_mps: int
    yaw_rate_radps: int
    heave_m: int
    """rise of the sprung mass above its place at rest"""
    heave_rate_mps: int
    roll_rad: int
    roll_rate_radps: int
    pitch_rad: int
    pitch_rate_radps: int
    spin_radps: int
    """first of four wheel speeds"""
    lateral_slip: int
    """first of four lagged tangents of the slip angle, positive when the force points left"""
    longitudinal_slip: int
    """first of four lagged slip ratios, positive when the wheel drives"""
    settled_ax_mps2: int
    """acceleration as the wheel loads feel it, behind the vertical give of the tyres"""
    settled_ay_mps2: int
    road_wheel_rad: int
    """front road-wheel angle, compliance included"""
    throttle: int
    """throttle opening behind its actuator"""
    brake_mpa: int
    """pressure in the front brake circuit"""
    engine_radps: int
    gear: int
    """engaged or being engaged, 1..6; changes only between steps"""
    gear_before: int
    since_shift_s: int


AT = StateIndex(
    vx_mps=0,
    vy_mps=1,
    yaw_rate_radps=2,
    heave_m=3,
    heave_rate_mps=4,
    roll_rad=5,
    roll_rate_radps=6,
    pitch_rad=7,
    pitch_rate_radps=8,
    spin_radps=9,
    lateral_slip=13,
    longitudinal_slip=17,
    settled_ax_mps2=21,
    settled_ay_mps2=22,
    road_wheel_rad=23,
    throttle=24,
    brake_mpa=25,
    engine_radps=26,
    gear=27,
    gear_before=28,
    since_shift_s=29,
)
N_STATES = 30
N_WHEELS = 4
