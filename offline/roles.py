"""What the learning may assume of each signal, by name.

Which signals there are is the data set's affair (`rt_controller.contract.schema`); what their
zero means, and which of them a mirror reverses, no table of numbers can tell.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.errors import DatasetError
from rt_controller.contract.fitness import DRIVABLE_HISTORY
from rt_controller.contract.schema import Schema

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Roles:
    """Names of signals that the learning treats in a way of their own."""

    centred: tuple[str, ...]
    """never near zero, so shifted to their mean before they are scaled"""
    odd: tuple[str, ...] | None
    """change sign when left and right are exchanged; None: the car has no such symmetry"""
    past: tuple[str, ...]
    """states and inputs that one row of history holds"""

    def __post_init__(self) -> None:
        both = sorted(set(self.centred) & set(self.odd or ()))
        if both:
            raise DatasetError(
                f"roles: expected a signal to be centred or to change sign in a mirror, found "
                f"both for {', '.join(both)}. What a mirror reverses is measured from zero."
            )


VEHICLE_ROLES = Roles(
    centred=("vx_mps", "ds_m"),
    odd=("vy_mps", "yaw_rate_radps", "ey_m", "epsi_rad", "steer_rad", "curvature_per_m"),
    past=DRIVABLE_HISTORY,
)
"""of the car in the Frenet frame: what it did to the road is no part of its memory"""


def mirror_signs(names: tuple[str, ...], roles: Roles) -> Array:
    """-1 for each of these signals that a mirror reverses, else +1."""
    odd = roles.odd or ()
    return np.array([-1.0 if name in odd else 1.0 for name in names])


def past_columns(schema: Schema, roles: Roles) -> tuple[list[int], list[int]]:
    """Columns of the states and of the inputs that a row of history holds."""
    return (
        [i for i, name in enumerate(schema.state_names) if name in roles.past],
        [i for i, name in enumerate(schema.input_names) if name in roles.past],
    )


def past_names(schema: Schema, roles: Roles) -> tuple[str, ...]:
    """Names of the signals in a row of history, in the order of its columns."""
    names = schema.state_names + schema.input_names
    return tuple(name for name in names if name in roles.past)
