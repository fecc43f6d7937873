"""Which of the lifted coordinates describe the motion, the path and a constant."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from offline.config import TrainingConfig
from offline.data.signals import (
    VEHICLE_ROLES,
    Roles,
    has_path,
    mirror_signs,
    past_columns,
    past_names,
)
from rt_controller.contract.signals import PATH_STATES, Schema


class Observables(NamedTuple):
    """Numbers of observables of each kind, in their order."""

    states: int
    latents: int
    """without the constant"""
    has_constant: bool
    has_path: bool
    """the path states follow from the motion by kinematics; False: one block of all observables"""
    signs: Tensor
    """(n,) of each observable in a mirror image, -1 if it changes sign; all +1 if they are neither
    even nor odd"""

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
    signs, constant = signs_of(config, sizes), torch.ones(int(config.constant_observable))
    of_states = torch.ones(sizes.states) if signs is None else torch.tensor(signs.states)
    # Alternating: each kind has latents of all initial time constants.
    latent_signs = torch.ones(latents) if signs is None else alternating(latents)
    all_signs = torch.cat([of_states, latent_signs, constant])
    return Observables(sizes.states, latents, config.constant_observable, has_path, all_signs)


class Signs(NamedTuple):
    """Of signals in a mirror image, -1 for each that changes sign, otherwise +1."""

    states: tuple[float, ...]
    inputs: tuple[float, ...]
    exogenous: tuple[float, ...]
    remembered: tuple[float, ...]
    """in one row of the history"""


def signs_of(config: TrainingConfig, sizes: "Sizes") -> Signs | None:
    """The signs of the signals if each observable is even or odd in a mirror image.

    So they are in a model of a symmetric car. A model of any car that begins with such a model
    keeps its lift, and its matrices may mix both kinds.
    """
    is_even_or_odd = sizes.is_symmetric or config.init is not None
    return sizes.signs if config.symmetry == "exact" and is_even_or_odd else None


def alternating(count: int) -> Tensor:
    """Signs (count,): +1, -1, +1, …"""
    return 1.0 - 2.0 * (torch.arange(count) % 2)


@dataclass(frozen=True, slots=True)
class Sizes:
    """Number of signals of each kind, and the sampling period."""

    states: int
    inputs: int
    exogenous: int
    remembered: int
    """signals in one row of the history"""
    dt_s: float
    signs: Signs
    is_symmetric: bool
    """left and right of the car are alike"""
    has_path: bool = False
    """the states are those of a car on a road, and the first exogenous signal is its curvature"""


def sizes_of(schema: Schema, roles: Roles) -> Sizes:
    """The sizes of a model of these signals."""
    states, inputs = past_columns(schema, roles)
    groups = schema.state_names, schema.input_names, schema.exogenous_names
    usual = VEHICLE_ROLES if roles.odd is None and has_path(schema) else roles
    signs = (mirror_signs(names, usual) for names in (*groups, past_names(schema, roles)))
    return Sizes(
        len(schema.states),
        len(schema.inputs),
        len(schema.exogenous),
        len(states) + len(inputs),
        schema.dt_s,
        Signs(*(tuple(each.tolist()) for each in signs)),
        roles.odd is not None,
        has_path(schema),
    )
