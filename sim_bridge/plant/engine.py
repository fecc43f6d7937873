"""The engine: torque over speed and throttle, with drag, idle governor and speed limiter."""

from math import pi

from sim_bridge.plant.car_parts import EngineParameters
from sim_bridge.plant.jit import compiled

RPM_OF_RADPS = 30.0 / pi


@compiled
def full_load_nm(speed_rpm: float, engine: EngineParameters) -> float:
    """Torque at full throttle: smooth around its peak, falling faster towards high speed."""
    off_krpm = (speed_rpm - engine.peak_speed_rpm) / 1000.0
    square = off_krpm * off_krpm
    if off_krpm < 0.0:
        return (
            engine.peak_torque_nm
            - engine.fall_below_nm * square
            - engine.fall_below_quartic_nm * square * square
        )
    return (
        engine.peak_torque_nm
        - engine.fall_above_nm * square
        - engine.fall_above_quartic_nm * square * square
    )


@compiled
def drag_nm(speed_rpm: float, engine: EngineParameters) -> float:
    """Torque of the engine without fuel, negative."""
    return engine.drag_nm + engine.drag_nm_per_krpm * (speed_rpm - engine.idle_speed_rpm) / 1000.0


@compiled
def torque_nm(speed_radps: float, throttle: float, kept: float, engine: EngineParameters) -> float:
    """Torque at the crankshaft; below idle speed the governor adds what keeps the engine alive.

    `kept` is the share of the fired torque that the gearbox does not take back for a shift.
    """
    speed_rpm = speed_radps * RPM_OF_RADPS
    dragging_nm = drag_nm(speed_rpm, engine)
    opening = throttle * (1.0 + engine.pedal_shape) / (throttle + engine.pedal_shape)
    fuel = min(1.0, max(0.0, (engine.speed_limit_rpm - speed_rpm) / 200.0))
    fired_nm = kept * opening * fuel * (full_load_nm(speed_rpm, engine) - dragging_nm)
    below_rpm = engine.idle_speed_rpm - speed_rpm
    governor_nm = engine.idle_gain_nm_per_rpm * below_rpm - engine.drag_nm
    governor_nm = min(engine.idle_torque_limit_nm, max(0.0, governor_nm))
    return dragging_nm + fired_nm + (1.0 - opening) * governor_nm
