"""Networks that carry a hidden state over the horizon.

An encoder turns the first state and the past half second into the first hidden state; the inputs
then drive it from step to step. All signals are scaled.
"""

from enum import StrEnum
from typing import NamedTuple

import torch
from torch import Tensor, nn

_LATENT_RATE = 0.1
"""change of a latent state in a step for an output of 1"""


class Kind(StrEnum):
    """What carries the hidden state from step to step."""

    GATED = "gated"
    STATE_SPACE = "state-space"


class Size(NamedTuple):
    """Size of a network."""

    kind: Kind
    hidden: int = 64
    """hidden state of a gated network, or units of the layers of a transition"""
    layers: int = 1
    """hidden layers of the transition of a state-space model"""
    latents: int = 13
    """states of a state-space model besides the learned ones"""
    encoder: int = 128
    """width of the two hidden layers of the encoder"""


class Gated(nn.Module):
    """A gated recurrent unit, whose hidden state gives the change of the states in each step.

    Cho et al., 2014.
    """

    spread: Tensor

    def __init__(self, size: Size, seen: int, driven: int, spread: Tensor) -> None:
        super().__init__()
        self.encode = _encoder(seen, size.encoder, size.hidden)
        self.recur = nn.GRU(driven, size.hidden)
        self.change = nn.Linear(size.hidden, len(spread))
        self.register_buffer("spread", spread)

    def forward(self, x0: Tensor, seen: Tensor, driven: Tensor) -> Tensor:
        """Learned states (K, batch, n) after each step.

        x0 (batch, n) are the first ones, seen (batch, s) is what the encoder reads, and driven
        (K, batch, d) are inputs and exogenous signals.
        """
        hidden, _ = self.recur(driven, self.encode(seen)[None])
        return x0 + torch.cumsum(self.change(hidden) * self.spread, dim=0)


class StateSpace(nn.Module):
    """z_(k+1) = z_k + rate f(z_k, u_k), where z are the learned states and latent ones.

    f is a perceptron, the rates are the spread of each state's change. An encoder of the past gives
    the first latent states, as in the method SUBNET of Beintema, Toth and Schoukens, 2021.
    """

    rate: Tensor

    def __init__(self, size: Size, seen: int, driven: int, spread: Tensor) -> None:
        super().__init__()
        states = len(spread) + size.latents
        self.encode = _encoder(seen, size.encoder, size.latents)
        self.drive = nn.Linear(driven, size.hidden)
        self.enter = nn.Linear(states, size.hidden, bias=False)
        self.layers = nn.ModuleList(
            nn.Linear(size.hidden, size.hidden) for _ in range(size.layers - 1)
        )
        self.leave = nn.Linear(size.hidden, states)
        self.register_buffer("rate", torch.cat([spread, torch.full((size.latents,), _LATENT_RATE)]))

    def forward(self, x0: Tensor, seen: Tensor, driven: Tensor) -> Tensor:
        """Learned states (K, batch, n) after each step; arguments as of `Gated.forward`."""
        n = x0.shape[1]
        z, states = torch.cat([x0, self.encode(seen)], dim=1), []
        into, out = self.enter.weight.t(), self.leave.weight.t() * self.rate
        offset = self.leave.bias * self.rate
        for drive in self.drive(driven):
            value = torch.tanh(torch.addmm(drive, z, into))
            for layer in self.layers:
                value = torch.tanh(layer(value))
            z = z + torch.addmm(offset, value, out)
            states.append(z[:, :n])
        return torch.stack(states)


def build(size: Size, seen: int, driven: int, spread: Tensor) -> Gated | StateSpace:
    """A network with random weights.

    Args:
        size: kind and size.
        seen: number of the signals that the encoder reads.
        driven: number of inputs and exogenous signals.
        spread: (n,) of the change of each learned state over a step.
    """
    return (Gated if size.kind is Kind.GATED else StateSpace)(size, seen, driven, spread)


def _encoder(seen: int, width: int, out: int) -> nn.Sequential:
    return nn.Sequential(
        *(nn.Linear(seen, width), nn.SiLU()),
        *(nn.Linear(width, width), nn.SiLU()),
        *(nn.Linear(width, out), nn.Tanh()),
    )
