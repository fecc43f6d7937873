"""The steering: from the steering wheel to the angle of the front wheels."""

from sim_bridge.plant.jit import compiled
from sim_bridge.plant.parameters import SteeringParameters


@compiled
def steady_road_wheel_rad(
    steer_rad: float, front_left_n: float, steering: SteeringParameters
) -> float:
    """Road-wheel angle at rest: the wheel's angle through the ratio, eased by the axle's force.

    `front_left_n` is the lateral force of both front tyres, positive to the left.
    """
    return steer_rad / steering.ratio - steering.compliance_radpn * front_left_n
