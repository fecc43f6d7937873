"""Which of the lifted coordinates describe the motion, the path and a constant."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from offline.config import TrainingConfig
from offline.data.signals import Roles, has_path, mirror_signs, past_columns, past_names
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
    """(n,) of each observable in a mirror image, -1 if it changes sign; of a model without symmetry
    all +1"""

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
    # Alternating: each kind has latents of all initial time constants.
    latent_signs = alternating(latents) if is_symmetric(config, sizes) else torch.ones(latents)
    all_signs = torch.cat([torch.tensor(signs.states), latent_signs, constant])
    return Observables(sizes.states, latents, config.constant_observable, has_path, all_signs)


class Signs(NamedTuple):
    """Of signals in a mirror image, -1 for each that changes sign, otherwise +1."""

    states: tuple[float, ...]
    inputs: tuple[float, ...]
    exogenous: tuple[float, ...]
    remembered: tuple[float, ...]
    """in one row of the history"""


def is_symmetric(config: TrainingConfig, sizes: "Sizes") -> bool:
    """True if each observable is even or odd in a mirror image."""
    return config.symmetry == "exact" and any(-1.0 in signs for signs in sizes.signs)


def signs_of(config: TrainingConfig, sizes: "Sizes") -> Signs:
    """The signs of the signals; all +1 for a model without symmetry."""
    if is_symmetric(config, sizes):
        return sizes.signs
    return Signs(*((1.0,) * len(signs) for signs in sizes.signs))


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
    """all +1 if the car has no such symmetry"""
    has_path: bool = False
    """the states are those of a car on a road, and the first exogenous signal is its curvature"""


def sizes_of(schema: Schema, roles: Roles) -> Sizes:
    """The sizes of a model of these signals."""
    states, inputs = past_columns(schema, roles)
    groups = schema.state_names, schema.input_names, schema.exogenous_names
    signs = (mirror_signs(names, roles) for names in (*groups, past_names(schema, roles)))
    return Sizes(
        len(schema.states),
        len(schema.inputs),
        len(schema.exogenous),
        len(states) + len(inputs),
        schema.dt_s,
        Signs(*(tuple(each.tolist()) for each in signs)),
        has_path(schema),
    )
