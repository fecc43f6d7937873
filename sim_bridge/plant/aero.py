"""Air: drag and lift of a car that moves straight ahead in still air."""

from typing import NamedTuple

from sim_bridge.plant.car_parts import AeroParameters
from sim_bridge.plant.jit import compiled


class AirForce(NamedTuple):
    """Force of the air on the body."""

    forward_n: float
    up_n: float


@compiled
def air_force(vx_mps: float, aero: AeroParameters) -> AirForce:
    """Drag against the motion and lift, both growing with the square of the speed."""
    pressure_n = 0.5 * aero.air_density_kgpm3 * aero.area_m2 * vx_mps * vx_mps
    drag_n = aero.drag * pressure_n
    return AirForce(-drag_n if vx_mps > 0.0 else drag_n, aero.lift * pressure_n)
