"""Drive and brakes of a car as named tuples of numbers, as `car_parts` for the chassis."""

from typing import NamedTuple

from sim_bridge.plant.car_values import (
    N_MAP_PEDALS,
    N_MAP_SPEEDS,
    Efficiencies,
    MapPedals,
    MapSpeeds,
    MapTorques,
    NonNegative,
    Positive,
    PositiveShare,
    Ratios,
    Share,
)


class EngineParameters(NamedTuple):
    """Combustion engine: torque map, idle governor, speed limit; see `engine`."""

    inertia_kgm2: Positive
    map_speeds_rpm: MapSpeeds
    map_throttles: MapPedals
    map_nm: MapTorques
    """torque at the crankshaft; the row of the closed throttle is the drag of the engine"""
    idle_speed_rpm: Positive
    idle_gain_nm_per_rpm: Positive
    idle_torque_limit_nm: Positive
    speed_limit_rpm: Positive
    throttle_lag_s: Positive


class MotorParameters(NamedTuple):
    """Electric motor, in place of engine, converter and gearbox; see `engine`."""

    inertia_kgm2: NonNegative
    """of everything between the motor and the give of the shafts, at motor speed; 0: no motor"""
    map_speeds_rpm: MapSpeeds
    map_throttles: MapPedals
    map_nm: MapTorques
    """torque at the shaft; negative torque of the released pedal charges the battery"""
    lag_s: Positive


class ConverterParameters(NamedTuple):
    """Hydrodynamic torque converter; see `powertrain`."""

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
    shift_shape: Positive
    """power of the throttle with which the shift speeds rise from closed to open"""


class DrivelineParameters(NamedTuple):
    """From the gearbox to the wheels; see `powertrain`."""

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


class AntiLockParameters(NamedTuple):
    """Anti-lock system: it releases the brake of a wheel whose slip is too large; see `brakes`."""

    slip: NonNegative
    """wanted largest slip; 0: no anti-lock system"""
    slip_band: Positive
    """deviation from the wanted slip at which the valves move with full speed"""
    release_per_s: Positive
    """share of the pressure released in a second"""
    apply_per_s: Positive
    least_speed_mps: Positive
    """below it the brakes are not released"""
    rear_share: NonNegative
    """largest slip of the rear wheels over that of the front wheels: brake-force distribution"""


class TractionControlParameters(NamedTuple):
    """Traction control: it reduces the torque of engine or motor; see `powertrain`."""

    slip: NonNegative
    """wanted largest slip of the driven wheels; 0: no traction control"""
    slip_band: Positive
    """deviation from the wanted slip at which the torque changes with full speed"""
    cut_per_s: Positive
    """share of the torque taken away in a second"""
    restore_per_s: Positive


_NO_SPEEDS = tuple(float(i) for i in range(N_MAP_SPEEDS))
_NO_PEDALS = tuple(i / (N_MAP_PEDALS - 1.0) for i in range(N_MAP_PEDALS))
_NO_TORQUES = ((0.0,) * N_MAP_SPEEDS,) * N_MAP_PEDALS
NO_ENGINE = EngineParameters(1.0, _NO_SPEEDS, _NO_PEDALS, _NO_TORQUES, 1.0, 1.0, 1.0, 1.0, 1.0)
NO_MOTOR = MotorParameters(0.0, _NO_SPEEDS, _NO_PEDALS, _NO_TORQUES, 1.0)
NO_CONVERTER = ConverterParameters(1.0, 1.0, 1.0, 1.0, 1.0)
ONE_GEAR = GearboxParameters((1.0,) * 6, (1.0,) * 6, 1.0, 0.0, 1.0, 1e9, 1e9, 1e8, 1e8, 1.0)
"""always in the first gear: no shaft is faster than these shift speeds"""
NO_ANTI_LOCK = AntiLockParameters(0.0, 1.0, 1.0, 1.0, 1.0, 1.0)
NO_TRACTION_CONTROL = TractionControlParameters(0.0, 1.0, 1.0, 1.0)
