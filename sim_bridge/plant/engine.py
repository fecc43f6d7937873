"""The engine: torque over speed and throttle, with drag, idle governor and speed limiter."""

from math import pi

from sim_bridge.plant.car_parts import EngineParameters
from sim_bridge.plant.jit import compiled

RPM_OF_RADPS = 30.0 / pi


@compiled
def full_load_nm(speed_rpm: float, engine: EngineParameters) -> float:
    """Torque at full throttle: polynomials of fourth order below and above the peak."""
    off_krpm = (speed_rpm - engine.peak_speed_rpm) / 1000.0
    square = off_krpm * off_krpm
    fall_nm, quartic_nm = engine.fall_above_nm, engine.fall_above_quartic_nm
    if off_krpm < 0.0:
        fall_nm, quartic_nm = engine.fall_below_nm, engine.fall_below_quartic_nm
    return engine.peak_torque_nm - fall_nm * square - quartic_nm * square * square


@compiled
def torque_nm(speed_radps: float, throttle: float, kept: float, engine: EngineParameters) -> float:
    """Torque at the crankshaft; below idle speed the governor adds torque.

    `kept` is the share of the combustion torque that a shift leaves, see `gearbox.kept_torque`.
    """
    speed_rpm = speed_radps * RPM_OF_RADPS
    above_rpm = speed_rpm - engine.idle_speed_rpm
    friction_nm = engine.drag_nm + engine.drag_nm_per_krpm * above_rpm / 1000.0
    opening = throttle * (1.0 + engine.pedal_shape) / (throttle + engine.pedal_shape)
    fuel = min(1.0, max(0.0, (engine.speed_limit_rpm - speed_rpm) / 200.0))
    combustion_nm = kept * opening * fuel * (full_load_nm(speed_rpm, engine) - friction_nm)
    governor_nm = -engine.idle_gain_nm_per_rpm * above_rpm - engine.drag_nm
    governor_nm = min(engine.idle_torque_limit_nm, max(0.0, governor_nm))
    return friction_nm + combustion_nm + (1.0 - opening) * governor_nm
