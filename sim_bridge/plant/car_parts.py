"""The parts of a car as nested tuples of floats, which compiled kernels accept as they are.

Each name ends in its unit, a name without one is a pure number; a pair of front and rear values
is two fields. The numbers themselves, each with its source, stand in the files under `cars/`.
"""

from typing import NamedTuple

GRAVITY_MPS2 = 9.80665


class BodyParameters(NamedTuple):
    """Masses, inertias and where they sit; the rest of the car hangs on these lengths."""

    mass_kg: float
    yaw_inertia_kgm2: float
    front_axle_m: float
    """from the centre of gravity of the whole car forward to the front axle"""
    rear_axle_m: float
    """backward to the rear axle, positive"""
    track_front_m: float
    track_rear_m: float
    width_m: float
    """of the body; for lanes, not for dynamics"""
    sprung_mass_kg: float
    sprung_roll_inertia_kgm2: float
    sprung_pitch_inertia_kgm2: float
    sprung_front_axle_m: float
    """from the centre of gravity of the sprung mass forward to the front axle"""
    sprung_rear_axle_m: float
    sprung_height_m: float
    unsprung_front_kg: float
    """both wheels of the axle"""
    unsprung_rear_kg: float
    unsprung_height_m: float


class SuspensionParameters(NamedTuple):
    """What stands between body and wheels, seen at the wheels; see `suspension`."""

    spring_front_npm: float
    spring_rear_npm: float
    bar_front_nmprad: float
    bar_rear_nmprad: float
    jounce_front_nspm: float
    jounce_rear_nspm: float
    rebound_front_nspm: float
    rebound_rear_nspm: float
    roll_centre_front_m: float
    roll_centre_rear_m: float
    pitch_centre_m: float
    """height of the axis of pitch, which the slopes of the arms in side view add up to"""
    roll_steer_front: float
    """road-wheel angle per roll angle against the wheels, positive into the turn"""
    roll_steer_rear: float
    camber_gain_front: float
    """wheel lean against the ground per roll angle"""
    camber_gain_rear: float


class TyreParameters(NamedTuple):
    """Magic Formula of one tyre on the reference road; see `tyres`."""

    rolling_radius_m: float
    spin_inertia_kgm2: float
    vertical_stiffness_npm: float
    vertical_damping_nspm: float
    reference_load_n: float
    lateral_friction: float
    longitudinal_friction: float
    lateral_friction_per_load: float
    """relative change per relative excess over the reference load"""
    longitudinal_friction_per_load: float
    cornering_stiffness_npr: float
    """at the load at which it would peak"""
    cornering_stiffness_load_n: float
    """that load"""
    lateral_shape: float
    """C of the Magic Formula"""
    lateral_curvature: float
    """E of the Magic Formula"""
    slip_stiffness: float
    """longitudinal force per slip and load"""
    longitudinal_shape: float
    longitudinal_curvature: float
    lateral_weight: float
    """how fast lateral force fades with longitudinal slip"""
    longitudinal_weight: float
    """how fast longitudinal force fades with lateral slip"""
    camber_slip: float
    """equivalent lateral slip per radian of lean"""
    trail_m: float
    trail_shape: float
    trail_stiffness: float
    """per slip; with the shape it says where the pneumatic trail ends"""
    lateral_relaxation_m: float
    longitudinal_relaxation_m: float
    relaxation_load_n: float
    """load for which the two relaxation lengths hold"""
    lateral_relaxation_end_slip: float
    """slip at which the relaxation length has faded"""
    longitudinal_relaxation_end_slip: float
    damping_end_mps: float
    """speed at which the material damping of the tyre has lost half its effect"""
    lateral_damping_s: float
    longitudinal_damping_s: float
    rolling_resistance: float
    rolling_resistance_spm: float
    """growth with speed, per m/s"""


class EngineParameters(NamedTuple):
    """Full-load torque around its peak, drag, idle; see `engine`."""

    inertia_kgm2: float
    peak_torque_nm: float
    peak_speed_rpm: float
    fall_below_nm: float
    """torque lost a thousand rpm below the peak, square and fourth power"""
    fall_below_quartic_nm: float
    fall_above_nm: float
    """the same above the peak"""
    fall_above_quartic_nm: float
    drag_nm: float
    drag_nm_per_krpm: float
    idle_speed_rpm: float
    idle_gain_nm_per_rpm: float
    idle_torque_limit_nm: float
    speed_limit_rpm: float
    pedal_shape: float
    """smaller: more of the torque in the first part of the pedal's way"""
    throttle_lag_s: float


class ConverterParameters(NamedTuple):
    """Hydrodynamic torque converter; see `converter`."""

    stall_torque_ratio: float
    coupling_speed_ratio: float
    capacity_nm_per_rpm2: float
    """torque at stall over engine speed squared"""
    capacity_fade: float
    """power of the speed ratio with which the capacity fades"""
    turbine_inertia_kgm2: float
    """of everything between the converter and the shafts' give, at turbine speed"""


class GearboxParameters(NamedTuple):
    """Ratios, efficiencies and the shift map; see `gearbox`."""

    ratios: tuple[float, float, float, float, float, float]
    efficiencies: tuple[float, float, float, float, float, float]
    shift_time_s: float
    shift_dip: float
    """share of the engine's torque taken back in the middle of an up-shift"""
    dwell_s: float
    """shortest time from one shift's start to the next"""
    up_rpm: float
    """turbine speed of an up-shift with the throttle closed; then open, then down-shifts alike"""
    up_rpm_full: float
    down_rpm: float
    down_rpm_full: float


class DrivelineParameters(NamedTuple):
    """From the gearbox to the wheels; see `driveline`."""

    final_ratio: float
    final_efficiency: float
    front_share: float
    viscous_nms: float
    """torque at the propeller shafts per difference of their speeds"""
    shaft_stiffness_nmprad: float
    """of all shafts together, at the wheels"""
    shaft_damping_nms: float


class BrakeParameters(NamedTuple):
    """From the pedal to the discs; see `brakes`."""

    pedal_mpa_per_n: float
    lag_s: float
    knee_mpa: float
    slope_above_knee: float
    front_nm_per_mpa: float
    rear_nm_per_mpa: float


class SteeringParameters(NamedTuple):
    """From the steering wheel to the front wheels, seen at the front wheels; see `steering`."""

    ratio: float
    stiffness_nmprad: float
    damping_nms: float
    inertia_kgm2: float
    friction_nm: float
    caster_trail_m: float


class AeroParameters(NamedTuple):
    """Air forces; see `aero`."""

    air_density_kgpm3: float
    area_m2: float
    drag: float
    lift: float


class RoadParameters(NamedTuple):
    """The ground under the tyres of each side, against the road on which the tyre was measured."""

    friction_left: float
    friction_right: float
