"""Which of the lifted coordinates describe the motion, the path and a constant."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from offline.config import TrainingConfig
from offline.data.recording import PATH_STATES
from offline.data.signals import Roles, past_columns
from rt_controller.contract.signals import VEHICLE, Schema

SPEED = "vx_mps"
ROAD_SIGNALS = ("curvature_per_m",)
"""exogenous signals that act on the path only"""


class PathColumns(NamedTuple):
    """Columns of the path states among the states."""

    ds: int
    ey: int
    epsi: int


def path_columns(schema: Schema) -> PathColumns | None:
    """The columns of the path states; None if the signals have no path."""
    names = schema.state_names
    if not set(PATH_STATES) <= set(names):
        return None
    return PathColumns(*(names.index(name) for name in PATH_STATES))


class Observables(NamedTuple):
    """Numbers of observables of each kind, in their order."""

    states: int
    path: PathColumns | None
    """None: one block"""
    motion_latents: int
    """all learned latents if there is one block"""
    path_latents: int
    has_constant: bool
    is_path_exact: bool = False
    """True: the path follows from the motion by kinematics, and no row of A, B or N predicts it"""

    @property
    def n(self) -> int:
        return self.states + self.motion_latents + self.path_latents + int(self.has_constant)

    @property
    def is_motion(self) -> Tensor:
        """(n,) True for the states and latents of the motion, and for the constant."""
        found = torch.ones(self.n, dtype=torch.bool)
        if self.path is not None:
            found[list(self.path)] = False
            found[self._path_latents] = False
        return found

    @property
    def is_gain_of_path(self) -> Tensor:
        """(n,) True for what the effect of an input on a learned path may depend on."""
        found = self.is_motion
        found[self._path_latents] = True
        return found

    def blocks(self) -> list[Tensor]:
        """Indices of the blocks of A that have eigenvalues of their own.

        Without the constant and, if the motion is separate, without the path states.
        """
        motion = self.is_motion
        if self.has_constant:
            motion[-1] = False
        path = ~self.is_motion
        path[: self.states] = False
        return [block for block in (motion.nonzero()[:, 0], path.nonzero()[:, 0]) if len(block)]

    @property
    def is_predicted(self) -> Tensor:
        """(n,) True for what A, B and the gains predict."""
        return self.is_motion if self.is_path_exact else torch.ones(self.n, dtype=torch.bool)

    def coupling(self) -> tuple[Tensor, Tensor]:
        """Which entries of A are learned, and those that are 1; (n, n), True or False."""
        one = torch.zeros(self.n, self.n, dtype=torch.bool)
        if self.path is None:
            return ~one, one
        motion, learned = self.is_motion, one.clone()
        learned[motion] = motion
        if self.is_path_exact:
            return learned, one
        learned[~motion] = self.is_gain_of_path
        _, ey, epsi = self.path
        learned[ey, epsi] = True
        one[ey, ey] = one[epsi, epsi] = True
        return learned, one

    @property
    def _path_latents(self) -> slice:
        first = self.states + self.motion_latents
        return slice(first, first + self.path_latents)


def observables_of(config: TrainingConfig, sizes: "Sizes") -> Observables:
    """The observables of a model with this configuration.

    At most half of the learned latents describe the path.
    """
    learned = config.latents - int(config.constant_observable)
    path = sizes.path if config.separate_motion else None
    is_exact = path is not None and config.path == "exact" and sizes.is_vehicle
    path_latents = 0 if path is None or is_exact else min(config.path_latents, learned // 2)
    return Observables(
        sizes.states,
        path,
        learned - path_latents,
        path_latents,
        config.constant_observable,
        is_exact,
    )


@dataclass(frozen=True, slots=True)
class Sizes:
    """Number of signals of each kind, the sampling period, and the columns of path and road."""

    states: int
    inputs: int
    exogenous: int
    remembered: int
    """signals in one row of the history"""
    dt_s: float
    path: PathColumns | None = None
    """of the path states; None: the signals have none"""
    road: tuple[int, ...] = ()
    """exogenous signals that act on the path only"""
    speed: int | None = None
    """column of the longitudinal speed, which progress is nearly proportional to"""
    is_vehicle: bool = False
    """the signals are those of a car on a road, whose kinematics are known"""


def sizes_of(schema: Schema, roles: Roles) -> Sizes:
    """The sizes of a model of these signals."""
    states, inputs = past_columns(schema, roles)
    return Sizes(
        len(schema.states),
        len(schema.inputs),
        len(schema.exogenous),
        len(states) + len(inputs),
        schema.dt_s,
        path_columns(schema),
        tuple(i for i, name in enumerate(schema.exogenous_names) if name in ROAD_SIGNALS),
        schema.state_names.index(SPEED) if SPEED in schema.state_names else None,
        schema == VEHICLE,
    )
