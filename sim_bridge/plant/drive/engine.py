"""Engine and electric motor: torque over speed and pedal from a map.

The engine has drag, an idle governor and a speed limiter besides.
"""

from math import pi

from sim_bridge.plant.car_values import N_MAP_PEDALS, N_MAP_SPEEDS
from sim_bridge.plant.drive.drive_parts import EngineParameters, MotorParameters
from sim_bridge.plant.jit import compiled

RPM_OF_RADPS = 30.0 / pi
_LIMITER_BAND_RPM = 200.0


@compiled
def map_column(speed_rpm: float, speeds_rpm: tuple[float, ...]) -> tuple[int, float]:
    """Column left of a speed and the share of the way to the next; the map ends constant."""
    column = 0
    while column < N_MAP_SPEEDS - 2 and speed_rpm >= speeds_rpm[column + 1]:
        column += 1
    way = (speed_rpm - speeds_rpm[column]) / (speeds_rpm[column + 1] - speeds_rpm[column])
    return column, min(1.0, max(0.0, way))


@compiled
def map_nm(
    column: int,
    way: float,
    pedal: float,
    pedals: tuple[float, ...],
    torques_nm: tuple[tuple[float, ...], ...],
) -> float:
    """Torque between four points of a map, linear in speed and pedal."""
    row = 0
    while row < N_MAP_PEDALS - 2 and pedal >= pedals[row + 1]:
        row += 1
    up = min(1.0, max(0.0, (pedal - pedals[row]) / (pedals[row + 1] - pedals[row])))
    lower, upper = torques_nm[row], torques_nm[row + 1]
    lower_nm = lower[column] + way * (lower[column + 1] - lower[column])
    upper_nm = upper[column] + way * (upper[column + 1] - upper[column])
    return lower_nm + up * (upper_nm - lower_nm)


@compiled
def torque_nm(speed_radps: float, throttle: float, kept: float, engine: EngineParameters) -> float:
    """Torque at the crankshaft; below idle speed the governor adds torque.

    `kept` is the share of the combustion torque that shift and traction control leave.
    """
    speed_rpm = speed_radps * RPM_OF_RADPS
    above_rpm = speed_rpm - engine.idle_speed_rpm
    column, way = map_column(speed_rpm, engine.map_speeds_rpm)
    drag_nm = map_nm(column, way, 0.0, engine.map_throttles, engine.map_nm)
    total_nm = map_nm(column, way, throttle, engine.map_throttles, engine.map_nm)
    fuel = min(1.0, max(0.0, (engine.speed_limit_rpm - speed_rpm) / _LIMITER_BAND_RPM))
    governor_nm = -engine.idle_gain_nm_per_rpm * above_rpm - drag_nm
    governor_nm = min(engine.idle_torque_limit_nm, max(0.0, governor_nm))
    # With the throttle open the governor only fills what is missing to its own torque.
    return drag_nm + max(governor_nm, kept * fuel * (total_nm - drag_nm))


@compiled
def motor_nm(speed_radps: float, pedal: float, kept: float, motor: MotorParameters) -> float:
    """Torque at the shaft of the motor; `kept` is the share that the traction control leaves.

    It reduces drive and regeneration alike.
    """
    column, way = map_column(speed_radps * RPM_OF_RADPS, motor.map_speeds_rpm)
    return kept * map_nm(column, way, pedal, motor.map_throttles, motor.map_nm)
