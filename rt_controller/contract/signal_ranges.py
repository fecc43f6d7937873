"""Ranges of state and path as the bus has them, for callers that use no bus."""

from typing import TypeVar

from rt_controller.contract.signals import PathReference, VehicleState

Vector = TypeVar("Vector", VehicleState, PathReference)

SMALLEST_STATE = VehicleState(
    vx_mps=-20.0, vy_mps=-25.0, yaw_rate_radps=-3.0, ds_m=-3.0, ey_m=-30.0, epsi_rad=-3.2
)
LARGEST_STATE = VehicleState(
    vx_mps=100.0, vy_mps=25.0, yaw_rate_radps=3.0, ds_m=3.0, ey_m=30.0, epsi_rad=3.2
)
SMALLEST_PATH = PathReference(
    c0_m=-30.0, c1=-0.6, c2_per_m=-0.032, c3_per_m2=-0.0064, v_mps=0.0, a_mps2=-15.0
)
LARGEST_PATH = PathReference(
    c0_m=30.0, c1=0.6, c2_per_m=0.032, c3_per_m2=0.0064, v_mps=100.0, a_mps2=15.0
)


def require_in_range(name: str, found: Vector, smallest: Vector, largest: Vector) -> None:
    """Return if all fields are within their ranges; NaN is not.

    Raises:
        ValueError: one is not; `name` is that of the argument.
    """
    for field, value, low, high in zip(found._fields, found, smallest, largest, strict=True):
        if not low <= value <= high:
            raise ValueError(
                f"{name}.{field}: expected {low:g} to {high:g}, found {value:g}. The name ends in "
                f"the unit."
            )
