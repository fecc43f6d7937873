"""Which of the lifted coordinates describe the motion, the path and a constant."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from offline.config import TrainingConfig
from offline.data.signals import Roles, has_path, past_columns
from rt_controller.contract.signals import PATH_STATES, Schema


class Observables(NamedTuple):
    """Numbers of observables of each kind, in their order."""

    states: int
    latents: int
    """without the constant"""
    has_constant: bool
    has_path: bool
    """the path states follow from the motion by kinematics; False: one block of all observables"""

    @property
    def n(self) -> int:
        return self.states + self.latents + int(self.has_constant)

    @property
    def is_motion(self) -> Tensor:
        """(n,) True for what A, B and the gains predict, and depend on: all but the path states."""
        found = torch.ones(self.n, dtype=torch.bool)
        if self.has_path:
            found[PATH_STATES] = False
        return found

    @property
    def changing(self) -> Tensor:
        """Indices of the block of A without path states and constant."""
        motion = self.is_motion
        if self.has_constant:
            motion[-1] = False
        return motion.nonzero()[:, 0]


def observables_of(config: TrainingConfig, sizes: "Sizes") -> Observables:
    """The observables of a model with this configuration."""
    latents = config.latents - int(config.constant_observable)
    has_path = config.separate_motion and sizes.has_path
    return Observables(sizes.states, latents, config.constant_observable, has_path)


@dataclass(frozen=True, slots=True)
class Sizes:
    """Number of signals of each kind, and the sampling period."""

    states: int
    inputs: int
    exogenous: int
    remembered: int
    """signals in one row of the history"""
    dt_s: float
    has_path: bool = False
    """the states are those of a car on a road, and the first exogenous signal is its curvature"""


def sizes_of(schema: Schema, roles: Roles) -> Sizes:
    """The sizes of a model of these signals."""
    states, inputs = past_columns(schema, roles)
    return Sizes(
        len(schema.states),
        len(schema.inputs),
        len(schema.exogenous),
        len(states) + len(inputs),
        schema.dt_s,
        has_path(schema),
    )
