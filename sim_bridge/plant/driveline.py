"""From the gearbox to the wheels: shafts that wind up, a viscous centre differential, two open
axle differentials."""

from typing import NamedTuple

from sim_bridge.plant.car_parts import DrivelineParameters
from sim_bridge.plant.jit import compiled


class AxleTorque(NamedTuple):
    """Drive torque of each wheel of an axle."""

    front_wheel_nm: float
    rear_wheel_nm: float


@compiled
def driven_speed_radps(
    front_radps: float, rear_radps: float, driveline: DrivelineParameters
) -> float:
    """Speed of the wheels as the centre differential averages it; mean wheel speeds by axle."""
    return driveline.front_share * front_radps + (1.0 - driveline.front_share) * rear_radps


@compiled
def shaft_nm(wind_up_rad: float, wind_up_radps: float, driveline: DrivelineParameters) -> float:
    """Torque of the shafts, all together and at the wheels."""
    return (
        driveline.shaft_stiffness_nmprad * wind_up_rad + driveline.shaft_damping_nms * wind_up_radps
    )


@compiled
def axle_torque(
    shafts_nm: float, front_radps: float, rear_radps: float, driveline: DrivelineParameters
) -> AxleTorque:
    """Split by the differential's share; its viscous coupling helps the slower axle."""
    ratio = driveline.final_ratio
    coupled_nm = driveline.viscous_nms * ratio * ratio * (rear_radps - front_radps)
    lossy_nm = shafts_nm * driveline.final_efficiency
    if shafts_nm < 0.0:
        lossy_nm = shafts_nm / driveline.final_efficiency
    return AxleTorque(
        0.5 * (driveline.front_share * lossy_nm + coupled_nm),
        0.5 * ((1.0 - driveline.front_share) * lossy_nm - coupled_nm),
    )
