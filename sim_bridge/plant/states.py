"""The car's state vector: names and positions of its entries.

A state is a flat float64 array of `N_STATES` entries. Code addresses entries by name through `AT`,
never by number. Wheels are always ordered front left, front right, rear left, rear right; a state
that exists once per wheel takes four consecutive entries, and its name gives the first of them.
Axes: x forward, y left, z up; positive roll lowers the right side, positive pitch the nose.
The position on the road is not part of this vector, see `sim_bridge.frenet`.
"""

from itertools import accumulate
from typing import Annotated, NamedTuple

N_WHEELS = 4
PerWheel = Annotated[int, N_WHEELS]
"""position of a state that exists once per wheel"""


class StateIndex(NamedTuple):
    """Positions in the state vector; the compiler gets it as struct `State`."""

    vx_mps: int  # velocity of the centre of gravity of the whole car, body axes
    vy_mps: int
    yaw_rate_radps: int
    heave_m: int  # rise of the sprung mass above its position at rest
    heave_rate_mps: int
    roll_rad: int
    roll_rate_radps: int
    pitch_rad: int
    pitch_rate_radps: int
    rise_m: PerWheel  # rise above the position at rest
    rise_rate_mps: PerWheel
    spin_radps: PerWheel  # rotational speed
    lateral_slip: PerWheel
    """lagged tangent of the slip angle, positive if the force points left"""
    longitudinal_slip: PerWheel  # lagged slip ratio, positive if the wheel drives
    road_wheel_rad: int
    """front road-wheel angle at the steering, without roll steer and give of the bushings"""
    road_wheel_rate_radps: int
    front_compliance_rad: int
    """angle of the front wheels from the give of the bushings, positive to the left"""
    rear_compliance_rad: int
    contact_twist_rad: int  # twist of the contact patches of the front tyres against the ground
    throttle: int  # throttle opening after the actuator lag
    brake_mpa: PerWheel  # brake pressure before the anti-lock valves
    brake_release: PerWheel
    """share of the pressure that the anti-lock system takes away, 0..1"""
    torque_cut: int  # share of the drive torque that the traction control takes away, 0..1
    engine_radps: int
    turbine_radps: int  # turbine of the converter, with the gear sets behind it; an electric motor
    wind_up_rad: int  # twist of the drive shafts, at the wheels
    gear: int  # engaged or being engaged, 1..6; changes only between steps
    gear_before: int
    since_shift_s: int


_SIZES = [N_WHEELS if kind == PerWheel else 1 for kind in StateIndex.__annotations__.values()]
*_POSITIONS, N_STATES = accumulate(_SIZES, initial=0)
AT = StateIndex(*_POSITIONS)
