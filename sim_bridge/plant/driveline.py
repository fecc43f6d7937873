"""From the gearbox to the wheels: a viscous centre differential and two open axle differentials."""

from typing import NamedTuple

from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import DrivelineParameters


class AxleTorque(NamedTuple):
    """Drive torque of each wheel of an axle."""

    front_wheel_nm: float
    rear_wheel_nm: float


@compiled
def output_speed_radps(
    front_radps: float, rear_radps: float, driveline: DrivelineParameters
) -> float:
    """Speed of the gearbox's output shaft; arguments are the mean wheel speeds of the axles."""
    share = driveline.front_share
    return driveline.final_ratio * (share * front_radps + (1.0 - share) * rear_radps)


@compiled
def axle_torque(
    output_nm: float, front_radps: float, rear_radps: float, driveline: DrivelineParameters
) -> AxleTorque:
    """Split by the differential's share; its viscous coupling helps the slower axle."""
    ratio = driveline.final_ratio
    coupled_nm = driveline.viscous_nms * ratio * (rear_radps - front_radps)
    lossy_nm = output_nm * driveline.final_efficiency
    if output_nm < 0.0:
        lossy_nm = output_nm / driveline.final_efficiency
    return AxleTorque(
        0.5 * ratio * (driveline.front_share * lossy_nm + coupled_nm),
        0.5 * ratio * ((1.0 - driveline.front_share) * lossy_nm - coupled_nm),
    )
