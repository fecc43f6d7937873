"""A bundle is loaded as it was saved; a flipped bit is refused or makes no difference."""

import random
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from rt_controller.contract.errors import ArtifactError
from rt_controller.model.artifact import load_bundle, save_bundle
from rt_controller.model.bundle import Bundle

PLAIN = [
    "name",
    "A",
    "B_uc",
    "B_uw",
    "c",
    "encoder_onnx",
    "selftest_psi",
    "training",
    "data_sha256",
]


def equal(one: Bundle, other: Bundle) -> bool:
    if (one.schema, one.lift, one.car) != (other.schema, other.lift, other.car):
        return False
    parts = [
        (
            *bundle.selftest,
            *(bundle.gains or ()),
            *(bundle.plans or ()),
            *(bundle.validity or ()),
            *(bundle.movement or ()),
            *(() if bundle.signal_range is None else bundle.signal_range),
        )
        for bundle in (one, other)
    ]
    return len(parts[0]) == len(parts[1]) and all(
        np.array_equal(a, b)
        for a, b in (
            *((getattr(one, key), getattr(other, key)) for key in PLAIN),
            *zip(*parts, strict=True),
        )
    )


def test_a_saved_bundle_loads_equal(bundle, folder):
    compared = {*PLAIN, "schema", "lift", "car", "selftest", "gains", "plans"}
    compared |= {"signal_range", "movement", "validity"}
    assert compared == {field.name for field in fields(Bundle)}
    assert equal(load_bundle(folder), bundle)
    assert (folder / "card.md").read_text() == "# a card\n"


def test_a_model_of_other_signals_loads_equal(planar, tmp_path):
    save_bundle(tmp_path, planar, "card")
    assert equal(load_bundle(tmp_path), planar)


@pytest.mark.parametrize("part", ["gains", "signal_range", "validity"])
def test_a_part_that_a_model_does_not_have_is_not_loaded(bundle, tmp_path, part):
    without = replace(bundle, **{part: None})
    save_bundle(tmp_path, without, "card")
    assert getattr(load_bundle(tmp_path), part) is None
    assert equal(load_bundle(tmp_path), without)


def test_growth_radius_and_hash_are_stored_in_the_file(bundle, folder):
    with np.load(folder / "koopman.npz") as archive:
        assert float(archive["spectral_radius"]) == pytest.approx(
            max(abs(np.linalg.eigvals(bundle.A)))
        )
        assert float(archive["growth_80"]) == pytest.approx(bundle.growth(80))
        assert float(archive["growth_20"]) == pytest.approx(bundle.growth(20))
        assert str(archive["bundle_sha256"]) == bundle.sha256


def with_a_flipped_bit(whole: bytes, seed: int) -> bytes:
    rng = random.Random(seed)
    place = rng.randrange(len(whole))
    flipped = bytearray(whole)
    flipped[place] ^= 1 << rng.randrange(8)
    return bytes(flipped)


def unless_refused(folder: Path) -> Bundle | None:
    try:
        return load_bundle(folder)
    except ArtifactError:
        return None


def test_a_flipped_bit_in_the_matrices_is_refused_or_makes_no_difference(bundle, folder):
    """No difference: dates and other things that an archive says beside its content."""
    path = folder / "koopman.npz"
    whole = path.read_bytes()
    loaded = []
    for seed in range(400):
        path.write_bytes(with_a_flipped_bit(whole, seed))
        loaded.append(unless_refused(folder))
    assert all(found is None or equal(found, bundle) for found in loaded)
    assert 200 < loaded.count(None) < 400


def test_a_flipped_bit_in_the_encoder_is_refused(bundle, folder):
    encoder = bytes(random.Random(0).randbytes(2000))
    save_bundle(folder, replace(bundle, encoder_onnx=encoder), "card")
    for seed in range(100):
        (folder / "encoder.onnx").write_bytes(with_a_flipped_bit(encoder, seed))
        with pytest.raises(ArtifactError, match="SHA-256"):
            load_bundle(folder)
