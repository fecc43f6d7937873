"""The exact path in torch: that of `rt_controller.model.path_kinematics`, with its gradient."""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from offline.data.signals import Scaling
from offline.model.observables import Observables
from rt_controller.contract.signals import PATH_STATES
from rt_controller.contract.timing import PERIOD_S

N_MEANS = 3
"""of v_x, v_y and yaw rate, the first states"""
_STRAIGHT_PER_M = 1e-6
"""curvature below which the road is straight over the horizon"""


class Units(NamedTuple):
    """Centre and scale of the states (n,), and scale of the curvature ()."""

    centre: Tensor
    scale: Tensor
    curvature: Tensor


def units_of(scaling: Scaling) -> Units:
    """The units of scaled signals of the car."""
    x_centre, x_scale, (curvature,) = scaling.x_centre, scaling.x_scale, scaling.w_scale
    return Units(*(torch.as_tensor(each).float() for each in (x_centre, x_scale, curvature)))


class ExactPath(nn.Module):
    """Path states of predicted lifted states.

    The mean motion of a period is that at its begin plus a learned linear function of the motion.
    """

    def __init__(self, known: Observables, units: Units | None) -> None:
        super().__init__()
        if units is None:
            ones = torch.ones(known.states)
            units = Units(0.0 * ones, ones, torch.tensor(1.0))
        self.centre: Tensor
        self.scale: Tensor
        self.curvature: Tensor
        for name, value in units._asdict().items():
            self.register_buffer(name, value)
        self.is_motion: Tensor
        self.register_buffer("is_motion", known.is_motion.float(), persistent=False)
        self.change = nn.Parameter(torch.zeros(N_MEANS, known.n))

    def rows(self) -> Tensor:
        """(3, n), the scaled means as linear functions of psi."""
        return torch.eye(*self.change.shape).to(self.change) + self.change * self.is_motion

    def forward(self, psi0: Tensor, psi: Tensor, w: Tensor) -> Tensor:
        """The lifted states psi (K, batch, n) after 1..K steps from psi0, with their path states.

        w (K, batch, 1) has the curvature of the road in each step.
        """
        columns, n = PATH_STATES, N_MEANS
        scaled = torch.cat([psi0[None], psi[:-1]]) @ self.rows().t()
        means = scaled * self.scale[:n] + self.centre[:n]
        path, kappa = psi0[:, columns] * self.scale[columns] + self.centre[columns], w[..., 0]
        # One circle for the whole roll-out, or one for each step.
        length = len(w) if bool((kappa == kappa[0]).all()) else 1
        parts = []
        for moved, curvature in zip(torch.split(means, length), kappa[::length], strict=True):
            parts.append(path_of(moved, curvature * self.curvature, path))
            path = parts[-1][-1]
        scaled_path = (torch.cat(parts) - self.centre[columns]) / self.scale[columns]
        return torch.cat([psi[..., :n], scaled_path, psi[..., columns.stop :]], dim=-1)


def path_of(means: Tensor, curvature_per_m: Tensor, path: Tensor) -> Tensor:
    """Path states (K, batch, 3) at the ends of K periods on a circle.

    Means (K, batch, 3) of v_x, v_y and yaw rate; curvature (batch,); path (batch, 3) at the begin.
    """
    vx, vy, yaw_rate = means.unbind(-1)
    kappa = curvature_per_m
    turned = PERIOD_S * yaw_rate.cumsum(dim=0) + path[:, 2]
    middle = turned - 0.5 * PERIOD_S * yaw_rate
    cosine, sine = middle.cos(), middle.sin()
    x = PERIOD_S * (vx * cosine - vy * sine).cumsum(dim=0)
    y = PERIOD_S * (vx * sine + vy * cosine).cumsum(dim=0) + path[:, 1]
    ahead, sideways = kappa * x, 1.0 - kappa * y
    turn = torch.atan2(ahead, sideways)
    ey = (2.0 * y - kappa * (x * x + y * y)) / (1.0 + torch.hypot(ahead, sideways))
    is_straight = kappa.abs() < _STRAIGHT_PER_M
    s = torch.where(is_straight, x, turn / torch.where(is_straight, 1.0, kappa))
    ds = torch.diff(s, dim=0, prepend=torch.zeros_like(s[:1]))
    return torch.stack([ds, ey, turned - turn], dim=-1)
