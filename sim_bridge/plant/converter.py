"""The torque converter between engine and gearbox: a launch device and a soft coupling."""

from typing import NamedTuple

from sim_bridge.plant.engine import RPM_OF_RADPS
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import ConverterParameters


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
    if turbine_rpm <= engine_rpm:
        ratio = max(0.0, turbine_rpm / engine_rpm)
        impeller_nm = (
            converter.capacity_nm_per_rpm2 * engine_rpm * engine_rpm * (1.0 - ratio**converter.capacity_fade)
        )
        gain = (
            converter.stall_torque_ratio
            - (converter.stall_torque_ratio - 1.0) * ratio / converter.coupling_speed_ratio
        )
        return ConverterTorque(impeller_nm, impeller_nm * max(1.0, gain))
    ratio = engine_rpm / turbine_rpm
    dragged_nm = (
        converter.capacity_nm_per_rpm2 * turbine_rpm * turbine_rpm * (1.0 - ratio**converter.capacity_fade)
    )
    return ConverterTorque(-dragged_nm, -dragged_nm)
