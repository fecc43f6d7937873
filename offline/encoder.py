"""What makes the latents of what the encoder is shown. Paper: eq. (7).

Beside the paper's layers there may be all products of two signals of the present: a car's
kinematics is made of them (v_x e_psi, v_x times the yaw rate, v_x times the curvature), and layers
of smooth steps can only approximate a product.
"""

from itertools import pairwise

import torch
from torch import Tensor, nn


class Products(nn.Module):
    """A linear layer of the products of every two of `signals` signals, squares among them."""

    def __init__(self, signals: int, latents: int) -> None:
        super().__init__()
        one, other = torch.triu_indices(signals, signals)
        self.one: Tensor
        self.other: Tensor
        self.register_buffer("one", one, persistent=False)
        self.register_buffer("other", other, persistent=False)
        self.weights = nn.Linear(len(one), latents, bias=False)
        nn.init.zeros_(self.weights.weight)

    def forward(self, signals: Tensor) -> Tensor:
        """Latents (..., latents) of scaled signals (..., signals)."""
        latents: Tensor = self.weights(signals[..., self.one] * signals[..., self.other])
        return latents


class Encoder(nn.Module):
    """Latents (..., latents) of what is shown (..., shown), scaled, the present signals first."""

    def __init__(
        self,
        shown: int,
        present: int,
        hidden: tuple[int, ...],
        latents: int,
        *,
        activation: type[nn.Module],
        last_share: float,
        has_products: bool,
    ) -> None:
        """`present` of the `shown` signals are of this instant; only they are multiplied."""
        super().__init__()
        self.present = present
        self.layers = _multilayer_perceptron((shown, *hidden, latents), activation, last_share)
        self.products = Products(present, latents) if has_products else None

    def forward(self, shown: Tensor) -> Tensor:
        """As the class says."""
        return self.latents(shown, shown[..., : self.present])

    def latents(self, shown: Tensor, multiplied: Tensor) -> Tensor:
        """The same, where layers and products are given their signals in different units."""
        latents: Tensor = self.layers(shown)
        return latents if self.products is None else latents + self.products(multiplied)


def _multilayer_perceptron(
    widths: tuple[int, ...], activation: type[nn.Module], last_share: float
) -> nn.Sequential:
    """`activation` after every hidden layer, none on the output; Gaussian weights, zero biases.

    The spread sqrt(2 / fan_in) keeps the size of the signal through ReLU layers (He et al., 2015);
    the last layer has `last_share` of it.
    """
    layers: list[nn.Module] = []
    for fan_in, fan_out in pairwise(widths):
        linear = nn.Linear(fan_in, fan_out)
        share = last_share if len(layers) == 2 * (len(widths) - 2) else 1.0
        nn.init.normal_(linear.weight, std=share * (2.0 / fan_in) ** 0.5)
        nn.init.zeros_(linear.bias)
        layers += [linear, activation()]
    return nn.Sequential(*layers[:-1])
