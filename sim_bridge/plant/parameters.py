"""The numbers that make a car: nested tuples of floats that compiled kernels accept as they are.

Each name ends in its unit; a pair of front and rear values is two fields. Beside the default car
stands where its numbers come from: "published" for data of a C-class hatchback of 150 kW with
all-wheel drive, "derived" for what was computed from such data, "estimate" for judgement.
"""

from math import isfinite, pi
from typing import NamedTuple

from rt_controller.contract.errors import ConfigError

GRAVITY_MPS2 = 9.80665
_N_PER_M_OF_N_PER_MM = 1000.0
_PER_RAD_OF_PER_DEG = 180.0 / pi


class BodyParameters(NamedTuple):
    """Masses, inertias and where they sit; the rest of the car hangs on these lengths."""

    mass_kg: float
    yaw_inertia_kgm2: float
    front_axle_m: float
    """from the centre of gravity of the whole car forward to the front axle"""
    rear_axle_m: float
    """backward to the rear axle, positive"""
    track_m: float
    sprung_mass_kg: float
    sprung_roll_inertia_kgm2: float
    sprung_pitch_inertia_kgm2: float
    sprung_front_axle_m: float
    """from the centre of gravity of the sprung mass forward to the front axle"""
    sprung_rear_axle_m: float
    sprung_height_m: float
    unsprung_front_kg: float
    unsprung_rear_kg: float
    unsprung_height_m: float


class SuspensionParameters(NamedTuple):
    """Rates at the wheel, springs and bars in series with the tyre's vertical stiffness."""

    ride_rate_front_npm: float
    ride_rate_rear_npm: float
    bar_front_nmprad: float
    bar_rear_nmprad: float
    jounce_front_nspm: float
    jounce_rear_nspm: float
    rebound_front_nspm: float
    rebound_rear_nspm: float
    roll_centre_front_m: float
    roll_centre_rear_m: float
    pitch_centre_m: float
    load_lag_s: float
    """how long the tyres' vertical give delays what does not pass through springs"""
    roll_steer_front: float
    """road-wheel angle per roll angle, positive into the turn"""
    roll_steer_rear: float
    camber_gain_front: float
    """wheel lean against the ground per roll angle"""
    camber_gain_rear: float


class TyreParameters(NamedTuple):
    """Magic Formula of one tyre on the reference road; see `tyres`."""

    rolling_radius_m: float
    spin_inertia_kgm2: float
    reference_load_n: float
    peak_friction: float
    peak_friction_per_load: float
    """relative change of the peak per relative excess over the reference load"""
    stiffness_npr: float
    """cornering stiffness at the load at which it would peak"""
    stiffness_load_n: float
    """that load"""
    shape: float
    """C of the Magic Formula"""
    curvature: float
    """E of the Magic Formula"""
    longitudinal_slip_gain: float
    """lateral over longitudinal slip at the peak of friction"""
    peak_slip: float
    """tangent of the slip angle at the peak of friction"""
    camber_gain: float
    """equivalent lateral slip per radian of lean"""
    trail_m: float
    trail_end_slip: float
    """lateral slip at which the pneumatic trail is gone"""
    lateral_relaxation_m: float
    longitudinal_relaxation_m: float
    relaxation_load_n: float
    """load for which the two relaxation lengths hold"""
    lateral_relaxation_end_slip: float
    """lateral slip at which the relaxation length has faded"""
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
    """torque lost a thousand rpm below the peak, growing with the square"""
    fall_above_nm: float
    """the same above the peak, square and fourth power"""
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


class GearboxParameters(NamedTuple):
    """Ratios, efficiencies and the shift map; see `gearbox`."""

    ratios: tuple[float, float, float, float, float, float]
    efficiencies: tuple[float, float, float, float, float, float]
    shift_time_s: float
    shift_dip: float
    """share of the torque missing in the middle of a shift"""
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


class BrakeParameters(NamedTuple):
    """From the pedal to the discs; see `brakes`."""

    pedal_mpa_per_n: float
    lag_s: float
    knee_mpa: float
    slope_above_knee: float
    front_nm_per_mpa: float
    rear_nm_per_mpa: float


class SteeringParameters(NamedTuple):
    """From the steering wheel to the front wheels; see `steering`."""

    ratio: float
    compliance_radpn: float
    lag_s: float


class AeroParameters(NamedTuple):
    """Air forces; see `aero`."""

    air_density_kgpm3: float
    area_m2: float
    drag: float
    lift: float


class RoadParameters(NamedTuple):
    """The ground under the tyres."""

    friction: float
    """against the road on which the tyre was measured"""


class Parameters(NamedTuple):
    """A whole car on its road."""

    body: BodyParameters
    suspension: SuspensionParameters
    tyre: TyreParameters
    engine: EngineParameters
    converter: ConverterParameters
    gearbox: GearboxParameters
    driveline: DrivelineParameters
    brakes: BrakeParameters
    steering: SteeringParameters
    aero: AeroParameters
    road: RoadParameters


def with_road_friction(parameters: Parameters, friction: float) -> Parameters:
    """The same car on a road of another friction, 1 being the road of the tyre test.

    Raises:
        ConfigError: the friction is not a positive number.
    """
    if not (isfinite(friction) and friction > 0.0):
        raise ConfigError(
            f"road friction: expected a positive number, 1 for the road of the tyre test, found "
            f"{friction}. Dry asphalt is about 0.85, packed snow 0.3."
        )
    return parameters._replace(road=RoadParameters(friction=friction))


def _in_series(stiffness: float, other: float) -> float:
    return stiffness * other / (stiffness + other)


def _c_class_suspension() -> SuspensionParameters:
    """Rates as the road sees them: spring and bar at the wheel, then the tyre in series."""
    track_m = 1.675
    tyre_npm = 268.0 * _N_PER_M_OF_N_PER_MM
    spring_front_npm = 27.0 * _N_PER_M_OF_N_PER_MM * 0.959**2
    spring_rear_npm = 30.6 * _N_PER_M_OF_N_PER_MM * 0.797**2
    bar_front_nmprad = 384.0 * _PER_RAD_OF_PER_DEG
    bar_rear_nmprad = 345.0 * _PER_RAD_OF_PER_DEG
    ride_front_npm = _in_series(spring_front_npm, tyre_npm)
    ride_rear_npm = _in_series(spring_rear_npm, tyre_npm)
    lever_m2 = track_m**2 / 2.0
    return SuspensionParameters(
        ride_rate_front_npm=ride_front_npm,
        ride_rate_rear_npm=ride_rear_npm,
        bar_front_nmprad=_in_series(
            spring_front_npm * lever_m2 + bar_front_nmprad, tyre_npm * lever_m2
        )
        - ride_front_npm * lever_m2,
        bar_rear_nmprad=_in_series(
            spring_rear_npm * lever_m2 + bar_rear_nmprad, tyre_npm * lever_m2
        )
        - ride_rear_npm * lever_m2,
        # published at 90 mm/s of the damper, taken as linear; times the square of the motion ratio
        jounce_front_nspm=6600.0 * 0.959**2,
        jounce_rear_nspm=6600.0 * 0.797**2,
        rebound_front_nspm=11200.0 * 0.959**2,
        rebound_rear_nspm=11200.0 * 0.797**2,
        # derived
        roll_centre_front_m=0.023,
        roll_centre_rear_m=0.009,
        # estimates; the lag is that of a wheel bouncing on its tyre
        pitch_centre_m=0.10,
        load_lag_s=0.015,
        # front: set for an understeer gradient of 1.43 deg/g; rear: published
        roll_steer_front=-0.05,
        roll_steer_rear=0.14,
        # derived
        camber_gain_front=0.83,
        camber_gain_rear=0.68,
    )


C_CLASS_150KW_AWD = Parameters(
    # published; the height of the unsprung masses is that of the wheel centres
    body=BodyParameters(
        mass_kg=1501.0,
        yaw_inertia_kgm2=2192.0,
        front_axle_m=1.0496,
        rear_axle_m=1.8604,
        track_m=1.675,
        sprung_mass_kg=1270.0,
        sprung_roll_inertia_kgm2=536.6,
        sprung_pitch_inertia_kgm2=1536.7,
        sprung_front_axle_m=1.015,
        sprung_rear_axle_m=1.895,
        sprung_height_m=0.540,
        unsprung_front_kg=132.6,
        unsprung_rear_kg=98.4,
        unsprung_height_m=0.325,
    ),
    suspension=_c_class_suspension(),
    # 215/55R17: radius, inertia, friction, slips at the peak, rolling resistance published;
    # stiffness, camber thrust and relaxation derived; shape and curvature solve for the peak at
    # 8.5 deg and a friction of 0.88 left at 25 deg; effect of load on friction and the material
    # damping are estimates. The stiffness is 2 % above the axles' 161 and 93 kN/rad, which are
    # secants over the slip of everyday cornering.
    tyre=TyreParameters(
        rolling_radius_m=0.325,
        spin_inertia_kgm2=1.6,
        reference_load_n=4500.0,
        peak_friction=0.974,
        peak_friction_per_load=-0.08,
        stiffness_npr=226_470.0,
        stiffness_load_n=25_070.0,
        shape=1.42090,
        curvature=-0.12435,
        longitudinal_slip_gain=0.14945 / 0.14,
        peak_slip=0.14945,
        camber_gain=0.0265,
        trail_m=0.031,
        trail_end_slip=0.105,
        lateral_relaxation_m=0.65,
        longitudinal_relaxation_m=0.065,
        relaxation_load_n=6500.0,
        lateral_relaxation_end_slip=0.0524,
        damping_end_mps=1.0,
        lateral_damping_s=0.020,
        longitudinal_damping_s=0.004,
        rolling_resistance=0.0038,
        rolling_resistance_spm=2.6e-5 * 3.6,
    ),
    # inertia, peak, idle and drag published; full load passes through 151 kW at 5030 rpm with its
    # power peak there; fall below the peak, governor and pedal are estimates
    engine=EngineParameters(
        inertia_kgm2=0.20,
        peak_torque_nm=309.9,
        peak_speed_rpm=3603.0,
        fall_below_nm=28.0,
        fall_above_nm=2.824,
        fall_above_quartic_nm=4.208,
        drag_nm=-15.0,
        drag_nm_per_krpm=-12.4,
        idle_speed_rpm=750.0,
        idle_gain_nm_per_rpm=1.0,
        idle_torque_limit_nm=120.0,
        speed_limit_rpm=6400.0,
        pedal_shape=0.8,
        throttle_lag_s=0.10,
    ),
    # published; the fade is an estimate
    converter=ConverterParameters(
        stall_torque_ratio=1.864,
        coupling_speed_ratio=0.881,
        capacity_nm_per_rpm2=0.00704**2,
        capacity_fade=6.0,
    ),
    # ratios, range of efficiencies and shift time published; the shift map is an estimate
    gearbox=GearboxParameters(
        ratios=(3.538, 2.06, 1.404, 1.0, 0.713, 0.582),
        efficiencies=(0.92, 0.92, 0.95, 0.95, 0.98, 0.99),
        shift_time_s=0.25,
        shift_dip=0.8,
        dwell_s=0.8,
        up_rpm=1800.0,
        up_rpm_full=4500.0,
        down_rpm=900.0,
        down_rpm_full=2200.0,
    ),
    # final ratio and even split published; viscosity an estimate
    driveline=DrivelineParameters(
        final_ratio=4.1,
        final_efficiency=0.97,
        front_share=0.5,
        viscous_nms=4.0,
    ),
    # published, the pedal's gain an estimate: 150 N brake with about 0.8 g
    brakes=BrakeParameters(
        pedal_mpa_per_n=0.04,
        lag_s=0.06,
        knee_mpa=1.5,
        slope_above_knee=0.3,
        front_nm_per_mpa=250.0,
        rear_nm_per_mpa=150.0,
    ),
    # ratio published, compliance derived, lag an estimate
    steering=SteeringParameters(
        ratio=18.5,
        compliance_radpn=3.2e-5 * pi / 180.0,
        lag_s=0.03,
    ),
    # published
    aero=AeroParameters(
        air_density_kgpm3=1.206,
        area_m2=2.2,
        drag=0.30,
        lift=0.18,
    ),
    road=RoadParameters(friction=0.85),
)
