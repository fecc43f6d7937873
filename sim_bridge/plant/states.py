"""The car's state vector: which number stands where.

A state is a flat float64 array of `N_STATES` entries; code reaches into it by name through `AT`,
never by number. Wheels are always ordered front left, front right, rear left, rear right; an
entry that exists once per wheel names the first of four neighbours.
Axes: x forward, y left, z up; positive roll lowers the right side, positive pitch the nose.
Where the car is on its road is no part of this vector, see `sim_bridge.frenet`.
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
    rise_m: int
    """first of four rises of the wheels above their places at rest"""
    rise_rate_mps: int
    """first of four"""
    spin_radps: int
    """first of four wheel speeds"""
    lateral_slip: int
    """first of four lagged tangents of the slip angle, positive when the force points left"""
    longitudinal_slip: int
    """first of four lagged slip ratios, positive when the wheel drives"""
    road_wheel_rad: int
    """front road-wheel angle as the steering has it, without roll steer"""
    road_wheel_rate_radps: int
    throttle: int
    """throttle opening behind its actuator"""
    brake_mpa: int
    """first of four pressures at the wheels"""
    engine_radps: int
    turbine_radps: int
    """converter's turbine, with the gear sets behind it"""
    wind_up_rad: int
    """twist of the drive shafts, at the wheels"""
    gear: int
    """engaged or being engaged, 1..6; changes only between steps"""
    gear_before: int
    since_shift_s: int


N_WHEELS = 4
N_FRONT = 2
"""of the four, the first ones"""
WHEEL_STATES = (
    "rise_m",
    "rise_rate_mps",
    "spin_radps",
    "lateral_slip",
    "longitudinal_slip",
    "brake_mpa",
)
"""states that exist once per wheel"""


def _index() -> tuple[StateIndex, int]:
    positions: list[int] = []
    end = 0
    for name in StateIndex._fields:
        positions.append(end)
        end += N_WHEELS if name in WHEEL_STATES else 1
    return StateIndex(*positions), end


AT, N_STATES = _index()
