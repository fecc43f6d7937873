"""The chassis of a car as named tuples of numbers, with the limits of each number.

Compiled kernels take these tuples directly. Each name ends in its unit, a name without one is a
dimensionless number; a pair of front and rear values is two fields. The values, each with its
source, are in the files under `cars/`. The types state which values a car file may have. Engine,
gearbox and brakes are in `drive_parts`.
"""

from typing import NamedTuple

from sim_bridge.plant.car_values import NonNegative, Number, Positive, Share, Slope


class BodyParameters(NamedTuple):
    """Masses, inertias and where they sit; the rest of the car hangs on these lengths."""

    mass_kg: Positive
    yaw_inertia_kgm2: Positive
    front_axle_m: Positive
    """from the centre of gravity of the whole car forward to the front axle"""
    rear_axle_m: Positive
    """backward to the rear axle, positive"""
    track_front_m: Positive
    track_rear_m: Positive
    width_m: Positive
    """of the body; for lanes, not for dynamics"""
    sprung_mass_kg: Positive
    sprung_roll_inertia_kgm2: Positive
    sprung_pitch_inertia_kgm2: Positive
    sprung_front_axle_m: Positive
    """from the centre of gravity of the sprung mass forward to the front axle"""
    sprung_rear_axle_m: Positive
    sprung_height_m: Positive
    unsprung_front_kg: Positive
    """both wheels of the axle"""
    unsprung_rear_kg: Positive
    unsprung_height_m: Positive


class SuspensionParameters(NamedTuple):
    """What stands between body and wheels, seen at the wheels; see `suspension`."""

    spring_front_npm: Positive
    spring_rear_npm: Positive
    bar_front_nmprad: Number
    bar_rear_nmprad: Number
    jounce_front_nspm: NonNegative
    """damping of slow motion at the wheel, while the wheel moves towards the body"""
    jounce_rear_nspm: NonNegative
    rebound_front_nspm: NonNegative
    """the same while it moves away"""
    rebound_rear_nspm: NonNegative
    jounce_front_fast_nspm: NonNegative
    """slope far above the knee; equal to the slow one: a linear damper"""
    jounce_rear_fast_nspm: NonNegative
    rebound_front_fast_nspm: NonNegative
    rebound_rear_fast_nspm: NonNegative
    damper_knee_front_mps: Positive
    """speed of the wheel against the body around which the slope changes"""
    damper_knee_rear_mps: Positive
    stop_gap_front_m: Positive
    """travel from rest in either direction at which the wheel meets bump or rebound stop"""
    stop_gap_rear_m: Positive
    stop_front_npm2: NonNegative
    """force of a stop at the wheel per square of its compression; 0: no stops"""
    stop_rear_npm2: NonNegative
    roll_centre_front_m: Number
    roll_centre_rear_m: Number
    arm_slope_front: Number
    """upward force on the body per force of a brake at the wheel: against the dive"""
    arm_slope_rear: Number
    """downward force on the body per force of a brake at the wheel: against the lift"""
    centre_slope_front: Number
    """as `arm_slope_front`, for forces at the wheel centre: drive torque, which the body carries"""
    centre_slope_rear: Number
    roll_steer_front: Number
    """road-wheel angle per roll angle against the wheels, positive into the turn"""
    roll_steer_rear: Number
    lateral_steer_front_radpn: Number
    """wheel angle per lateral force of the axle, positive into the turn (with the force)"""
    lateral_steer_rear_radpn: Number
    aligning_steer_front_radpnm: Number
    """wheel angle per aligning moment of the axle, positive in the direction of the moment"""
    aligning_steer_rear_radpnm: Number
    compliance_lag_s: Positive
    """of the wheel angles behind force and moment"""
    camber_gain_front: Number
    """wheel lean against the ground per roll angle"""
    camber_gain_rear: Number


class TyreParameters(NamedTuple):
    """Magic Formula of one tyre on the reference road; see `tyres`."""

    rolling_radius_m: Positive
    spin_inertia_kgm2: Positive
    vertical_stiffness_npm: Positive
    vertical_damping_nspm: NonNegative
    reference_load_n: Positive
    lateral_friction: Positive
    longitudinal_friction: Positive
    lateral_friction_per_load: Number
    """relative change per relative excess over the reference load"""
    longitudinal_friction_per_load: Number
    cornering_stiffness_npr: Positive
    """at the load at which it would peak"""
    cornering_stiffness_load_n: Positive
    """that load"""
    lateral_shape: Positive
    """C of the Magic Formula"""
    lateral_curvature: Number
    """E of the Magic Formula"""
    slip_stiffness: Positive
    """longitudinal force per slip and load"""
    longitudinal_shape: Positive
    longitudinal_curvature: Number
    lateral_weight: Positive
    """how fast lateral force fades with longitudinal slip"""
    longitudinal_weight: Positive
    """how fast longitudinal force fades with lateral slip"""
    camber_slip: Number
    """equivalent lateral slip per radian of lean"""
    trail_m: NonNegative
    trail_shape: Positive
    trail_stiffness: Positive
    """per slip; with the shape it says where the pneumatic trail ends"""
    lateral_relaxation_m: Positive
    longitudinal_relaxation_m: Positive
    relaxation_load_n: Positive
    """load for which the two relaxation lengths hold"""
    lateral_relaxation_start_slip: NonNegative
    """slip from which the relaxation length fades"""
    lateral_relaxation_end_slip: Positive
    """slip at which it has faded"""
    longitudinal_relaxation_end_slip: Positive
    damping_end_mps: Positive
    """speed at which the material damping of the tyre has lost half its effect"""
    lateral_damping_s: NonNegative
    longitudinal_damping_s: NonNegative
    """limited for light wheels, see `wheels.longitudinal_damping_share`"""
    parking_torque_nm: NonNegative
    """largest moment of a standing tyre against turning about the vertical, at the reference load
    and on the road of the tyre test"""
    parking_twist_rad: Positive
    """turning angle over which the moment builds up"""
    parking_length_m: Positive
    """rolling distance over which it decays"""
    rolling_resistance: NonNegative
    rolling_resistance_spm: NonNegative
    """growth with speed, per m/s"""


class SteeringParameters(NamedTuple):
    """From the steering wheel to the front wheels, seen at the front wheels; see `steering`."""

    ratio: Positive
    stiffness_nmprad: Positive
    damping_nms: NonNegative
    inertia_kgm2: Positive
    friction_nm: NonNegative
    caster_trail_m: Number
    ackermann: Share
    """share of the difference of the wheel angles with which all wheels roll freely"""


class AeroParameters(NamedTuple):
    """Air forces; see `aero`."""

    air_density_kgpm3: Positive
    area_m2: Positive
    drag: NonNegative
    lift: Number
    side_force_slope: NonNegative
    """coefficient of side force per radian of the direction of the air flow"""
    side_force_ahead_m: Number
    """of the centre of gravity of the whole car: where the side force acts"""


class RoadParameters(NamedTuple):
    """The ground under the car and the wind, constant over a control period.

    Friction is relative to the road on which the tyre was measured. A car file gives the friction;
    slopes and wind are zero until a road sets them.
    """

    friction_left: Positive
    friction_right: Positive
    bank_rad: Slope = 0.0
    """cross slope, positive if the left side is higher"""
    grade_rad: Slope = 0.0
    """positive uphill"""
    wind_forward_mps: Number = 0.0
    """speed of the air over ground in the axes of the car: a tail wind is positive"""
    wind_left_mps: Number = 0.0
