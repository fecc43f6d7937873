"""The encoder: from states, road and history to the learned part of the lifted state."""

from collections.abc import Callable
from itertools import pairwise

import torch
from torch import Tensor, nn

from rt_controller.contract.errors import ConfigError

MakeEncoder = Callable[[int, int], nn.Module]
"""(width, latents) -> a module from scaled inputs (..., width) to latents (..., latents)"""


class Products(nn.Module):
    """A linear layer of the products of every two signals, squares included.

    Kinematics consists of such products (speed times heading error, yaw rate or curvature), which
    a multilayer perceptron can only approximate.
    """

    def __init__(self, signals: int, latents: int) -> None:
        super().__init__()
        first, second = torch.triu_indices(signals, signals)
        self.first: Tensor
        self.second: Tensor
        self.register_buffer("first", first, persistent=False)
        self.register_buffer("second", second, persistent=False)
        self.weights = nn.Linear(len(first), latents, bias=False)
        nn.init.zeros_(self.weights.weight)

    def forward(self, signals: Tensor) -> Tensor:
        """Latents (..., latents) of signals (..., signals)."""
        first, second = (signals.index_select(-1, each) for each in (self.first, self.second))
        latents: Tensor = self.weights(first * second)
        return latents


class OwnLayers(nn.Module):
    """A module that was passed in, in place of the multilayer perceptron.

    Its weights have other names than those of a perceptron, so neither is taken for the other.
    """

    def __init__(self, make: MakeEncoder, width: int, latents: int) -> None:
        super().__init__()
        self.own = make(width, latents)
        with torch.no_grad():
            found = tuple(self.own(torch.zeros(1, 2, width)).shape)
        if found != (1, 2, latents):
            raise ConfigError(
                f"encoder: expected a module from inputs (..., {width}) to latents (..., "
                f"{latents}), found {found} of inputs (1, 2, {width}). Return a module of this "
                f"shape from the function."
            )

    def forward(self, inputs: Tensor) -> Tensor:
        latents: Tensor = self.own(inputs)
        return latents


class Encoder(nn.Module):
    """Latents of the encoder's input: a multilayer perceptron, plus products if asked for.

    Paper: phi_theta of eq. (7).
    """

    def __init__(
        self,
        columns: list[int],
        present: int,
        hidden: tuple[int, ...],
        latents: int,
        *,
        activation: type[nn.Module],
        last_layer_share: float,
        has_products: bool,
        make: MakeEncoder | None = None,
        signs: tuple[Tensor, Tensor] | None = None,
    ) -> None:
        """Of all that the lift sees, `columns` are read.

        Only the first `present` of them, those of the current instant, enter the products. With
        `make` its module replaces the perceptron. `signs` in a mirror image, of the columns and of
        the latents, which are then even or odd: (f(x) ± f(x mirrored)) / 2.
        """
        super().__init__()
        self.present = present
        self.columns: Tensor
        self.register_buffer("columns", torch.tensor(columns), persistent=False)
        widths = (len(columns), *hidden, latents)
        self.layers: nn.Module = (
            _perceptron(widths, activation, last_layer_share)
            if make is None
            else OwnLayers(make, len(columns), latents)
        )
        self.products = Products(present, latents) if has_products else None
        self.is_symmetric = signs is not None
        if signs is not None:
            self.signs: Tensor
            self.latent_signs: Tensor
            self.register_buffer("signs", signs[0], persistent=False)
            self.register_buffer("latent_signs", signs[1], persistent=False)

    def forward(self, seen: Tensor) -> Tensor:
        """Latents (..., latents) of all scaled signals (..., s) that the lift sees."""
        inputs = seen.index_select(-1, self.columns)
        return self.latents(inputs, inputs[..., : self.present])

    def latents(self, inputs: Tensor, factors: Tensor) -> Tensor:
        """Latents if the factors (..., present) of the products are scaled unlike the inputs."""
        if not self.is_symmetric:
            return self._function(inputs, factors)
        both = torch.cat([inputs, inputs * self.signs])
        both_factors = torch.cat([factors, factors * self.signs[: self.present]])
        own, mirrored = torch.unflatten(self._function(both, both_factors), 0, (2, -1))
        symmetric: Tensor = 0.5 * (own + self.latent_signs * mirrored)
        return symmetric

    def _function(self, inputs: Tensor, factors: Tensor) -> Tensor:
        latents: Tensor = self.layers(inputs)
        return latents if self.products is None else latents + self.products(factors)


def _perceptron(
    widths: tuple[int, ...], activation: type[nn.Module], last_layer_share: float
) -> nn.Sequential:
    """Hidden layers with `activation`, a linear output; Gaussian weights, zero biases.

    The spread sqrt(2 / fan_in) keeps the size of the signal through ReLU layers (He et al., 2015);
    the last layer has `last_layer_share` of it.
    """
    layers: list[nn.Module] = []
    last = len(widths) - 2
    for i, (fan_in, fan_out) in enumerate(pairwise(widths)):
        linear = nn.Linear(fan_in, fan_out)
        share = last_layer_share if i == last else 1.0
        nn.init.normal_(linear.weight, std=share * (2.0 / fan_in) ** 0.5)
        nn.init.zeros_(linear.bias)
        layers.append(linear)
        if i < last:
            layers.append(activation())
    return nn.Sequential(*layers)
