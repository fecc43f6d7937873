"""The parts of a car as named tuples of numbers, with the limits of each number.

Compiled kernels take these tuples directly. Each name ends in its unit, a name without one is a
dimensionless number; a pair of front and rear values is two fields. The values, each with its
source, are in the files under `cars/`. The types state which values a car file may have.
"""

from typing import Annotated, Any, NamedTuple

from pydantic import BeforeValidator, Field


def _value_with_source(entry: Any) -> Any:
    """The value of an entry `{ value, source }` of a car file."""
    if not isinstance(entry, dict) or set(entry) != {"value", "source"}:
        raise ValueError("expected { value, source }")
    if not isinstance(entry["source"], str) or not entry["source"].strip():
        raise ValueError("expected a source in words")
    return entry["value"]


_IsNumber = Field(strict=True, allow_inf_nan=False)
_PositiveShare = Annotated[float, Field(strict=True, gt=0, le=1)]
_Ratio = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
_HasSource = BeforeValidator(_value_with_source)

Number = Annotated[float, _IsNumber, _HasSource]
NonNegative = Annotated[float, _IsNumber, Field(ge=0), _HasSource]
Positive = Annotated[float, _IsNumber, Field(gt=0), _HasSource]
Share = Annotated[float, _IsNumber, Field(ge=0, le=1), _HasSource]
PositiveShare = Annotated[_PositiveShare, _HasSource]
_PerGear = Field(min_length=6, max_length=6)
Ratios = Annotated[tuple[_Ratio, ...], _PerGear, _HasSource]
Efficiencies = Annotated[tuple[_PositiveShare, ...], _PerGear, _HasSource]


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
    jounce_rear_nspm: NonNegative
    rebound_front_nspm: NonNegative
    rebound_rear_nspm: NonNegative
    roll_centre_front_m: Number
    roll_centre_rear_m: Number
    pitch_centre_m: Number
    """height of the axis of pitch, which the slopes of the arms in side view add up to"""
    roll_steer_front: Number
    """road-wheel angle per roll angle against the wheels, positive into the turn"""
    roll_steer_rear: Number
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
    lateral_relaxation_end_slip: Positive
    """slip at which the relaxation length has faded"""
    longitudinal_relaxation_end_slip: Positive
    damping_end_mps: Positive
    """speed at which the material damping of the tyre has lost half its effect"""
    lateral_damping_s: NonNegative
    longitudinal_damping_s: NonNegative
    rolling_resistance: NonNegative
    rolling_resistance_spm: NonNegative
    """growth with speed, per m/s"""


class EngineParameters(NamedTuple):
    """Full-load torque around its peak, drag, idle; see `engine`."""

    inertia_kgm2: Positive
    peak_torque_nm: Positive
    peak_speed_rpm: Positive
    fall_below_nm: NonNegative
    """torque lost a thousand rpm below the peak, square and fourth power"""
    fall_below_quartic_nm: Number
    fall_above_nm: NonNegative
    """the same above the peak"""
    fall_above_quartic_nm: NonNegative
    drag_nm: Number
    drag_nm_per_krpm: Number
    idle_speed_rpm: Positive
    idle_gain_nm_per_rpm: Positive
    idle_torque_limit_nm: Positive
    speed_limit_rpm: Positive
    pedal_shape: Positive
    """smaller: more of the torque in the first part of the pedal's way"""
    throttle_lag_s: Positive


class ConverterParameters(NamedTuple):
    """Hydrodynamic torque converter; see `converter`."""

    stall_torque_ratio: Positive
    coupling_speed_ratio: PositiveShare
    capacity_nm_per_rpm2: Positive
    """torque at stall over engine speed squared"""
    capacity_fade: Positive
    """power of the speed ratio with which the capacity fades"""
    turbine_inertia_kgm2: Positive
    """of everything between the converter and the shafts' give, at turbine speed"""


class GearboxParameters(NamedTuple):
    """Ratios, efficiencies and the shift map; see `gearbox`."""

    ratios: Ratios
    efficiencies: Efficiencies
    shift_time_s: Positive
    shift_dip: Share
    """share of the engine's torque taken back in the middle of an up-shift"""
    dwell_s: Positive
    """shortest time from one shift's start to the next"""
    up_rpm: Positive
    """turbine speed of an up-shift with the throttle closed; then open, then down-shifts alike"""
    up_rpm_full: Positive
    down_rpm: Positive
    down_rpm_full: Positive


class DrivelineParameters(NamedTuple):
    """From the gearbox to the wheels; see `driveline`."""

    final_ratio: Positive
    final_efficiency: PositiveShare
    front_share: Share
    viscous_nms: NonNegative
    """torque at the propeller shafts per difference of their speeds"""
    shaft_stiffness_nmprad: Positive
    """of all shafts together, at the wheels"""
    shaft_damping_nms: NonNegative


class BrakeParameters(NamedTuple):
    """From the pedal to the discs; see `brakes`."""

    pedal_mpa_per_n: Positive
    lag_s: Positive
    knee_mpa: Positive
    slope_above_knee: Share
    front_nm_per_mpa: Positive
    rear_nm_per_mpa: Positive


class SteeringParameters(NamedTuple):
    """From the steering wheel to the front wheels, seen at the front wheels; see `steering`."""

    ratio: Positive
    stiffness_nmprad: Positive
    damping_nms: NonNegative
    inertia_kgm2: Positive
    friction_nm: NonNegative
    caster_trail_m: Number


class AeroParameters(NamedTuple):
    """Air forces; see `aero`."""

    air_density_kgpm3: Positive
    area_m2: Positive
    drag: NonNegative
    lift: Number


class RoadParameters(NamedTuple):
    """The ground under the tyres of each side, against the road on which the tyre was measured."""

    friction_left: Positive
    friction_right: Positive
