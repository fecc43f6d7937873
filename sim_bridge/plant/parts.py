"""The parts of a car as named tuples of numbers, with the limits of each number in a car file.

Each name ends in its unit, a name without one is a dimensionless number; a pair of front and rear
values is two fields. The values, each with its source, are in the files under `cars/`. The compiler
gets these tuples as structs (`records_header` in compiler.py).
"""

from typing import Annotated, Any, NamedTuple

from pydantic import BeforeValidator, Field


def value_with_source(entry: Any) -> Any:
    """The value of an entry `{ value, source }` of a car file."""
    if not isinstance(entry, dict) or set(entry) != {"value", "source"}:
        raise ValueError("expected { value, source }")
    if not isinstance(entry["source"], str) or not entry["source"].strip():
        raise ValueError("expected a source in words")
    return entry["value"]


_IsNumber = Field(strict=True, allow_inf_nan=False)
_Finite = Annotated[float, _IsNumber]
_PositiveShare = Annotated[_Finite, Field(gt=0, le=1)]
_HasSource = BeforeValidator(value_with_source)

Number = Annotated[float, _IsNumber, _HasSource]
NonNegative = Annotated[float, _IsNumber, Field(ge=0), _HasSource]
Positive = Annotated[float, _IsNumber, Field(gt=0), _HasSource]
Share = Annotated[float, _IsNumber, Field(ge=0, le=1), _HasSource]
STEEPEST_RAD = 0.7
"""slopes beyond are not roads; the equations hold for small angles of the car against the road"""
Slope = Annotated[float, _IsNumber, Field(ge=-STEEPEST_RAD, le=STEEPEST_RAD), _HasSource]
PositiveShare = Annotated[_PositiveShare, _HasSource]
N_GEARS = 6
_PerGear = Field(min_length=N_GEARS, max_length=N_GEARS)
Ratios = Annotated[tuple[Annotated[_Finite, Field(gt=0)], ...], _PerGear, _HasSource]
Efficiencies = Annotated[tuple[_PositiveShare, ...], _PerGear, _HasSource]

N_MAP = 8
"""speeds, and pedals, of the map of a motor"""
_Speeds = Field(min_length=N_MAP, max_length=N_MAP)
_Pedals = Field(min_length=N_MAP, max_length=N_MAP)
MapSpeeds = Annotated[tuple[Annotated[_Finite, Field(ge=0)], ...], _Speeds, _HasSource]
MapPedals = Annotated[tuple[Annotated[_Finite, Field(ge=0, le=1)], ...], _Pedals, _HasSource]
MapTorques = Annotated[tuple[Annotated[tuple[_Finite, ...], _Speeds], ...], _Pedals, _HasSource]
"""one row for each pedal position, one column for each speed"""


class BodyParameters(NamedTuple):
    """Masses, inertias and where they sit; the rest of the car hangs on these lengths."""

    mass_kg: Positive
    yaw_inertia_kgm2: Positive
    front_axle_m: Positive  # from the centre of gravity of the whole car forward to the front axle
    rear_axle_m: Positive  # backward to the rear axle, positive
    track_front_m: Positive
    track_rear_m: Positive
    width_m: Positive  # of the body; for lanes, not for dynamics
    sprung_mass_kg: Positive
    sprung_roll_inertia_kgm2: Positive
    sprung_pitch_inertia_kgm2: Positive
    sprung_front_axle_m: Positive  # from the centre of gravity of the sprung mass
    sprung_rear_axle_m: Positive
    sprung_height_m: Positive
    unsprung_front_kg: Positive  # both wheels of the axle
    unsprung_rear_kg: Positive
    unsprung_height_m: Positive

    @property
    def wheelbase_m(self) -> float:
        """Distance between the axles."""
        return self.front_axle_m + self.rear_axle_m


class SuspensionParameters(NamedTuple):
    """What stands between body and wheels, seen at the wheels; see chassis.c."""

    spring_front_npm: Positive
    spring_rear_npm: Positive
    bar_front_nmprad: Number
    bar_rear_nmprad: Number
    jounce_front_nspm: NonNegative  # of slow motion of the wheel towards the body
    jounce_rear_nspm: NonNegative
    rebound_front_nspm: NonNegative  # the same while it moves away
    rebound_rear_nspm: NonNegative
    jounce_front_fast_nspm: NonNegative  # slope far above the knee; as the slow one: linear
    jounce_rear_fast_nspm: NonNegative
    rebound_front_fast_nspm: NonNegative
    rebound_rear_fast_nspm: NonNegative
    damper_knee_front_mps: Positive  # wheel against body, where the slope changes
    damper_knee_rear_mps: Positive
    stop_gap_front_m: Positive  # travel from rest to bump or rebound stop
    stop_gap_rear_m: Positive
    stop_front_npm2: NonNegative  # force per square of compression; 0: no stops
    stop_rear_npm2: NonNegative
    roll_centre_front_m: Number
    roll_centre_rear_m: Number
    arm_slope_front: Number  # upward force on the body per brake force: against the dive
    arm_slope_rear: Number  # downward force per brake force: against the lift
    centre_slope_front: Number  # the same for drive forces, which act at the wheel centre
    centre_slope_rear: Number
    roll_steer_front: Number  # wheel angle per roll angle, positive into the turn
    roll_steer_rear: Number
    lateral_steer_front_radpn: Number  # of the axle, positive into the turn
    lateral_steer_rear_radpn: Number
    aligning_steer_front_radpnm: Number  # of the axle, positive with the moment
    aligning_steer_rear_radpnm: Number
    compliance_lag_s: Positive  # of the wheel angles behind force and moment
    camber_gain_front: Number  # wheel lean against the ground per roll angle
    camber_gain_rear: Number


class TyreParameters(NamedTuple):
    """Magic Formula of one tyre on the reference road; see tyre.c."""

    rolling_radius_m: Positive
    spin_inertia_kgm2: Positive
    vertical_stiffness_npm: Positive
    vertical_damping_nspm: NonNegative
    reference_load_n: Positive
    lateral_friction: Positive
    longitudinal_friction: Positive
    lateral_friction_per_load: Number  # relative change per relative excess over the reference load
    longitudinal_friction_per_load: Number
    cornering_stiffness_npr: Positive  # at the load at which it would peak
    cornering_stiffness_load_n: Positive  # that load
    lateral_shape: Positive  # C of the Magic Formula
    lateral_curvature: Number  # E of the Magic Formula
    slip_stiffness: Positive  # longitudinal force per slip and load
    longitudinal_shape: Positive
    longitudinal_curvature: Number
    lateral_weight: Positive  # how fast lateral force fades with longitudinal slip
    longitudinal_weight: Positive  # how fast longitudinal force fades with lateral slip
    camber_slip: Number  # equivalent lateral slip per radian of lean
    trail_m: NonNegative
    trail_shape: Positive
    trail_stiffness: Positive  # per slip; with the shape it says where the pneumatic trail ends
    lateral_relaxation_m: Positive
    longitudinal_relaxation_m: Positive
    relaxation_load_n: Positive  # load for which the two relaxation lengths hold
    lateral_relaxation_start_slip: NonNegative  # slip from which the relaxation length fades
    lateral_relaxation_end_slip: Positive  # slip at which it has faded
    longitudinal_relaxation_end_slip: Positive
    damping_end_mps: Positive  # where material damping has lost half its effect
    lateral_damping_s: NonNegative
    longitudinal_damping_s: NonNegative  # limited for light wheels, see wheels.c
    parking_torque_nm: NonNegative  # of a standing tyre at the reference load, friction 1
    parking_twist_rad: Positive  # turning angle over which the moment builds up
    parking_length_m: Positive  # rolling distance over which it decays
    rolling_resistance: NonNegative
    rolling_resistance_spm: NonNegative  # growth with speed, per m/s


class SteeringParameters(NamedTuple):
    """From the steering wheel to the front wheels, seen at the front wheels; see wheels.c."""

    ratio: Positive
    stiffness_nmprad: Positive
    damping_nms: NonNegative
    inertia_kgm2: Positive
    friction_nm: NonNegative
    caster_trail_m: Number
    ackermann: Share  # 1: all wheels roll freely, 0: parallel front wheels
    lock_rad: Positive  # largest angle of the steering wheel


class AeroParameters(NamedTuple):
    """Air forces; see chassis.c."""

    air_density_kgpm3: Positive
    area_m2: Positive
    drag: NonNegative
    lift: Number
    side_force_slope: NonNegative  # per radian of the direction of the air flow
    side_force_ahead_m: Number  # where it acts, of the centre of gravity


class RoadParameters(NamedTuple):
    """The ground under the car and the wind, constant over a control period.

    Friction is relative to the road on which the tyre was measured. A car file gives the friction;
    slopes and wind are zero until a road sets them.
    """

    friction_left: Positive
    friction_right: Positive
    bank_rad: Slope = 0.0  # cross slope, positive if the left side is higher
    grade_rad: Slope = 0.0  # positive uphill
    wind_forward_mps: Number = 0.0  # air over ground, positive: tail wind
    wind_left_mps: Number = 0.0


class EngineParameters(NamedTuple):
    """Combustion engine: torque map, idle governor, speed limit; see drive.c."""

    inertia_kgm2: Positive
    map_speeds_rpm: MapSpeeds
    map_throttles: MapPedals
    map_nm: MapTorques  # at the crankshaft; the first row is the drag of the engine
    idle_speed_rpm: Positive
    idle_gain_nm_per_rpm: Positive
    idle_torque_limit_nm: Positive
    speed_limit_rpm: Positive
    throttle_lag_s: Positive


class MotorParameters(NamedTuple):
    """Electric motor, in place of engine, converter and gearbox; see drive.c."""

    inertia_kgm2: NonNegative  # up to the give of the shafts, at motor speed; 0: no motor
    map_speeds_rpm: MapSpeeds
    map_throttles: MapPedals
    map_nm: MapTorques  # at the shaft; negative torque charges the battery
    lag_s: Positive


class ConverterParameters(NamedTuple):
    """Hydrodynamic torque converter; see drive.c."""

    stall_torque_ratio: Positive
    coupling_speed_ratio: PositiveShare
    capacity_nm_per_rpm2: Positive  # torque at stall over engine speed squared
    capacity_fade: Positive  # power of the speed ratio with which the capacity fades
    turbine_inertia_kgm2: Positive  # up to the shafts' give, at turbine speed


class GearboxParameters(NamedTuple):
    """Ratios, efficiencies and the shift map; see drive.c."""

    ratios: Ratios
    efficiencies: Efficiencies
    shift_time_s: Positive
    shift_dip: Share  # share of the engine's torque taken back in the middle of an up-shift
    dwell_s: Positive  # shortest time from one shift's start to the next
    up_rpm: Positive  # turbine speed with the throttle closed; `_full`: open
    up_rpm_full: Positive
    down_rpm: Positive
    down_rpm_full: Positive
    shift_shape: Positive  # power of the throttle with which shift speeds rise


class DrivelineParameters(NamedTuple):
    """From the gearbox to the wheels; see drive.c."""

    final_ratio: Positive
    final_efficiency: PositiveShare
    front_share: Share
    viscous_nms: NonNegative  # torque at the propeller shafts per difference of their speeds
    shaft_stiffness_nmprad: Positive  # of all shafts together, at the wheels
    shaft_damping_nms: NonNegative


class BrakeParameters(NamedTuple):
    """From the pedal to the discs; see drive.c."""

    pedal_mpa_per_n: Positive
    lag_s: Positive
    knee_mpa: Positive
    slope_above_knee: Share
    front_nm_per_mpa: Positive
    rear_nm_per_mpa: Positive


class AntiLockParameters(NamedTuple):
    """Anti-lock system: it releases the brake of a wheel whose slip is too large; see drive.c."""

    slip: NonNegative  # wanted largest slip; 0: no anti-lock system
    slip_band: Positive  # deviation at which the valves move with full speed
    release_per_s: Positive  # share of the pressure released in a second
    apply_per_s: Positive
    least_speed_mps: Positive  # below it the brakes are not released
    rear_share: NonNegative  # largest slip of the rear wheels over that of the front wheels


class TractionControlParameters(NamedTuple):
    """Traction control: it reduces the torque of engine or motor; see drive.c."""

    slip: NonNegative  # wanted largest slip of the driven wheels; 0: no traction control
    slip_band: Positive  # deviation at which the torque changes with full speed
    cut_per_s: Positive  # share of the torque taken away in a second
    restore_per_s: Positive


_NO_SPEEDS = tuple(float(i) for i in range(N_MAP))
_NO_PEDALS = tuple(i / (N_MAP - 1.0) for i in range(N_MAP))
_NO_TORQUES = ((0.0,) * N_MAP,) * N_MAP
NO_ENGINE = EngineParameters(1.0, _NO_SPEEDS, _NO_PEDALS, _NO_TORQUES, 1.0, 1.0, 1.0, 1.0, 1.0)
NO_MOTOR = MotorParameters(0.0, _NO_SPEEDS, _NO_PEDALS, _NO_TORQUES, 1.0)
NO_CONVERTER = ConverterParameters(1.0, 1.0, 1.0, 1.0, 1.0)
ONE_GEAR = GearboxParameters(
    (1.0,) * N_GEARS, (1.0,) * N_GEARS, 1.0, 0.0, 1.0, 1e9, 1e9, 1e8, 1e8, 1.0
)
"""always in the first gear: no shaft is faster than these shift speeds"""
NO_ANTI_LOCK = AntiLockParameters(0.0, 1.0, 1.0, 1.0, 1.0, 1.0)
NO_TRACTION_CONTROL = TractionControlParameters(0.0, 1.0, 1.0, 1.0)


class Payload(NamedTuple):
    """A load in the car, as a point mass in its plane of symmetry."""

    mass_kg: float = 0.0
    ahead_m: float = 0.0  # of the centre of gravity of the car without it; negative: behind
    height_m: float = 0.6  # above the ground


NO_PAYLOAD = Payload()
