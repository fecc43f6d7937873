"""The observables of a model, and which of them may depend on which.

The motion of a car on a plane does not depend on the road that is drawn on it: speeds and yaw rate
follow from themselves and the inputs, while progress, lateral and heading error follow from the
motion and the curvature. So psi = [x; latents of the motion; latents of the path; 1], and

- the motion depends on the motion;
- the latents of the path depend on the motion and on themselves;
- e_psi integrates, e_y integrates, e_y also depends on e_psi, and nothing else on either.

The eigenvalues of the two integrators are then exactly 1, and those of all other observables are
those of two blocks without integrators. Signals without a path have one block of all observables.

Paper: eq. (7), without the blocks.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from offline.config import TrainingConfig
from offline.data.recording import PATH_STATES
from rt_controller.contract.signals import Schema

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


class Coupling(NamedTuple):
    """Which entries of A are learned, and those that are 1; (n, n), True or False."""

    learned: Tensor
    one: Tensor


class Observables(NamedTuple):
    """Numbers of observables of each kind, in their order."""

    states: int
    path: PathColumns | None
    """None: one block"""
    motion_latents: int
    """all learned latents if there is one block"""
    path_latents: int
    has_constant: bool

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
        """(n,) True for what the effect of an input on the path may depend on."""
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

    def coupling(self) -> Coupling:
        """The entries of A."""
        one = torch.zeros(self.n, self.n, dtype=torch.bool)
        if self.path is None:
            return Coupling(~one, one)
        motion, learned = self.is_motion, one.clone()
        learned[motion] = motion
        learned[~motion] = self.is_gain_of_path
        _, ey, epsi = self.path
        learned[ey, epsi] = True
        one[ey, ey] = one[epsi, epsi] = True
        return Coupling(learned, one)

    @property
    def _path_latents(self) -> slice:
        first = self.states + self.motion_latents
        return slice(first, first + self.path_latents)


def observables_of(config: TrainingConfig, states: int, path: PathColumns | None) -> Observables:
    """The observables of a model with this configuration.

    At most half of the learned latents describe the path.
    """
    learned = config.latents - int(config.constant_observable)
    path = path if config.separate_motion else None
    path_latents = min(config.path_latents, learned // 2) if path is not None else 0
    return Observables(
        states, path, learned - path_latents, path_latents, config.constant_observable
    )
