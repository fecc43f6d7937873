"""The path in torch: that of `rt_controller.model.path_kinematics`, with its gradient."""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from offline.data.signals import Scaling
from offline.model.observables import Observables
from rt_controller.contract.signals import MOTION, PATH_STATES

_STRAIGHT_PER_M = 1e-6
"""curvature below which the road is straight over the horizon"""


class Units(NamedTuple):
    """Centre and scale of the states (n_x,), and scale of the curvature ()."""

    centre: Tensor
    scale: Tensor
    curvature: Tensor


def units_of(scaling: Scaling) -> Units:
    """The units of scaled signals of a car on a road."""
    numbers = scaling.x_centre, scaling.x_scale, scaling.w_scale[0]
    return Units(*(torch.as_tensor(each).float() for each in numbers))


class Path(nn.Module):
    """Path states of predicted lifted states.

    A period moves the car as v_x, v_y and yaw rate at its begin, plus a learned linear function of
    the motion: the change within the period.
    """

    def __init__(
        self, known: Observables, dt_s: float, units: Units | None, is_symmetric: bool
    ) -> None:
        super().__init__()
        if units is None:
            ones = torch.ones(known.states)
            units = Units(0.0 * ones, ones, torch.tensor(1.0))
        self._dt_s = dt_s
        self.centre: Tensor
        self.scale: Tensor
        self.curvature: Tensor
        for name, value in units._asdict().items():
            self.register_buffer(name, value)
        self.learned: Tensor
        learned = known.is_motion.expand(MOTION.stop, -1)
        if is_symmetric:
            learned = learned & (known.signs[MOTION, None] == known.signs)
        self.register_buffer("learned", learned.float(), persistent=False)
        self.change = nn.Parameter(torch.zeros(MOTION.stop, known.n))

    def movement(self) -> tuple[Tensor, Tensor]:
        """S (3, n) and s0 (3,) of `Movement`, for scaled lifted states."""
        rows = torch.eye(*self.change.shape).to(self.change) + self.change * self.learned
        return self._dt_s * self.scale[MOTION, None] * rows, self._dt_s * self.centre[MOTION]

    def take(self, S: Tensor) -> None:
        """Move as with these rows (3, n)."""
        rows = S / (self._dt_s * self.scale[MOTION, None])
        self.change.copy_(rows - torch.eye(*rows.shape).to(rows))

    def forward(self, psi0: Tensor, psi: Tensor, w: Tensor) -> Tensor:
        """The lifted states psi (K, batch, n) after 1..K steps from psi0, with their path states.

        w (K, batch, p) has the curvature of the road in each step first.
        """
        columns, (S, s0) = PATH_STATES, self.movement()
        moved = torch.cat([psi0[None], psi[:-1]]) @ S.t() + s0
        path, kappa = psi0[:, columns] * self.scale[columns] + self.centre[columns], w[..., 0]
        # One circle for the whole roll-out, or one for each step.
        length = len(w) if bool((kappa == kappa[0]).all()) else 1
        parts = []
        for part, curvature in zip(torch.split(moved, length), kappa[::length], strict=True):
            parts.append(path_of(part, curvature * self.curvature, path))
            path = parts[-1][-1]
        scaled = (torch.cat(parts) - self.centre[columns]) / self.scale[columns]
        return torch.cat([psi[..., MOTION], scaled, psi[..., columns.stop :]], dim=-1)


def path_of(moved: Tensor, curvature_per_m: Tensor, path: Tensor) -> Tensor:
    """Path states (K, batch, 3) at the ends of K periods on a circle.

    The movement (K, batch, 3) in each; curvature (batch,); path states (batch, 3) at the begin.
    """
    kappa, (forward, left, turn) = curvature_per_m, moved.unbind(-1)
    turned = turn.cumsum(dim=0) + path[:, 2]
    middle = turned - 0.5 * turn
    cosine, sine = middle.cos(), middle.sin()
    x = (forward * cosine - left * sine).cumsum(dim=0)
    y = (forward * sine + left * cosine).cumsum(dim=0) + path[:, 1]
    ahead, sideways = kappa * x, 1.0 - kappa * y
    of_road = torch.atan2(ahead, sideways)
    ey = (2.0 * y - kappa * (x * x + y * y)) / (1.0 + torch.hypot(ahead, sideways))
    is_straight = kappa.abs() < _STRAIGHT_PER_M
    s = torch.where(is_straight, x, of_road / torch.where(is_straight, 1.0, kappa))
    ds = torch.diff(s, dim=0, prepend=torch.zeros_like(s[:1]))
    return torch.stack([ds, ey, turned - of_road], dim=-1)
