"""The signals that an encoder reads, and their products."""

import pytest
import torch
from torch import nn

from offline.model.encoder import Encoder, Products

SHOWN, PRESENT, LATENTS = 11, 4, 5


def make(has_products: bool, columns: list[int] | None = None) -> Encoder:
    torch.manual_seed(0)
    return Encoder(
        list(range(SHOWN)) if columns is None else columns,
        PRESENT,
        (8, 8),
        LATENTS,
        activation=nn.SiLU,
        last_layer_share=1.0,
        has_products=has_products,
    )


def test_products_have_zero_weights_at_the_start() -> None:
    shown = torch.randn(20, SHOWN)
    assert torch.equal(make(True)(shown), make(False)(shown))


@pytest.mark.parametrize("one", range(PRESENT))
@pytest.mark.parametrize("other", range(PRESENT))
def test_every_product_of_two_signals_exists_once(one: int, other: int) -> None:
    products = Products(PRESENT, 1)
    assert products.weights.in_features == PRESENT * (PRESENT + 1) // 2
    signals = torch.randn(30, PRESENT)
    wanted = (signals[:, one] * signals[:, other])[:, None]
    pairs = signals[:, products.first] * signals[:, products.second]
    matching = torch.isclose(pairs, wanted).all(dim=0)
    assert int(matching.sum()) == 1
    with torch.no_grad():
        products.weights.weight[0, matching] = 1.0
    torch.testing.assert_close(products(signals), wanted)


def test_products_use_present_signals_only() -> None:
    encoder = make(True)
    assert encoder.products is not None
    with torch.no_grad():
        encoder.products.weights.weight.normal_()
    shown = torch.randn(20, SHOWN)
    later = shown.clone()
    later[:, PRESENT:] += 1.0
    added = encoder(shown) - encoder.layers(shown)
    torch.testing.assert_close(encoder(later) - encoder.layers(later), added, rtol=1e-4, atol=1e-5)
    later[:, 0] += 1.0
    assert not torch.allclose(encoder(later) - encoder.layers(later), added, rtol=1e-2)


def test_an_encoder_reads_its_columns_only_and_in_their_order() -> None:
    columns = [7, 1, 0, 4, 9]
    encoder, shown = make(True, columns), torch.randn(20, SHOWN)
    assert encoder.products is not None
    with torch.no_grad():
        encoder.products.weights.weight.normal_()
    chosen = shown[:, columns]
    assert torch.equal(encoder(shown), encoder.latents(chosen, chosen[:, :PRESENT]))
    for column in range(SHOWN):
        other = shown.clone()
        other[:, column] += 1.0
        assert torch.equal(encoder(other), encoder(shown)) == (column not in columns)
