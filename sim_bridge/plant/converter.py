"""The torque converter between engine and gearbox: a launch device and a soft coupling."""

from typing import NamedTuple

from sim_bridge.plant.car_parts import ConverterParameters
from sim_bridge.plant.engine import RPM_OF_RADPS
from sim_bridge.plant.jit import compiled


class ConverterTorque(NamedTuple):
    """Torque taken from the engine and torque given to the gearbox."""

    impeller_nm: float
    turbine_nm: float


@compiled
def converter_torque(
    engine_radps: float, turbine_radps: float, converter: ConverterParameters
) -> ConverterTorque:
    """Torques at both ends; a turbine faster than the engine drags it along.

    The capacity is full at stall and fades with a power of the speed ratio; both branches meet at
    equal speeds with the same slope.
    """
    engine_rpm = max(1.0, engine_radps * RPM_OF_RADPS)
    turbine_rpm = turbine_radps * RPM_OF_RADPS
    if turbine_rpm > engine_rpm:
        dragged_nm = _capacity_nm(turbine_rpm, engine_rpm / turbine_rpm, converter)
        return ConverterTorque(-dragged_nm, -dragged_nm)
    ratio = max(0.0, turbine_rpm / engine_rpm)
    impeller_nm = _capacity_nm(engine_rpm, ratio, converter)
    gain = (
        converter.stall_torque_ratio
        - (converter.stall_torque_ratio - 1.0) * ratio / converter.coupling_speed_ratio
    )
    return ConverterTorque(impeller_nm, impeller_nm * max(1.0, gain))


@compiled
def _capacity_nm(faster_rpm: float, ratio: float, converter: ConverterParameters) -> float:
    full_nm = converter.capacity_nm_per_rpm2 * faster_rpm * faster_rpm
    return full_nm * (1.0 - float(ratio**converter.capacity_fade))
