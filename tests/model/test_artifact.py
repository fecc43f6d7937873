"""A bundle is loaded as it was saved, or it is refused with expected, found, remedy."""

import random
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from rt_controller.contract.car import Car
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import SteeringGeometry
from rt_controller.model.artifact import load_bundle, save_bundle
from rt_controller.model.bundle import Bundle, PlanSample

PLAIN = (
    "name",
    "A",
    "B_uc",
    "B_uw",
    "c",
    "encoder_onnx",
    "selftest_psi",
    "training",
    "data_sha256",
)


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


CAR = SteeringGeometry(wheelbase_m=3.2, rear_axle_m=1.5, steering_ratio=16.0)


def test_the_geometry_of_the_car_is_part_of_a_bundle(bundle, tmp_path):
    known = replace(bundle, car=Car(CAR))
    save_bundle(tmp_path, known, "card")
    assert load_bundle(tmp_path).geometry == CAR
    assert known.sha256 != bundle.sha256


def test_a_model_of_other_signals_loads_equal(planar, tmp_path):
    save_bundle(tmp_path, planar, "card")
    assert equal(load_bundle(tmp_path), planar)


@pytest.mark.parametrize("part", ["gains", "signal_range", "validity"])
def test_a_part_that_a_model_does_not_have_is_not_loaded(bundle, tmp_path, part):
    without = replace(bundle, **{part: None})
    save_bundle(tmp_path, without, "card")
    assert getattr(load_bundle(tmp_path), part) is None
    assert equal(load_bundle(tmp_path), without)


def with_plans(bundle: Bundle) -> Bundle:
    """The same with stored plans."""
    rng = np.random.default_rng(2)
    return replace(
        bundle,
        plans=PlanSample(
            state=rng.normal(size=(2, 6)),
            curvature_per_m=rng.normal(size=2),
            path=rng.normal(size=(2, 6)),
            previous=rng.normal(size=(2, 3)),
            inputs=rng.normal(size=(2, 4, 3)),
        ),
    )


def rewrite(folder: Path, *, without: str) -> None:
    """Write the file again without this field."""
    path = folder / "koopman.npz"
    with np.load(path) as archive:
        kept = {key: archive[key] for key in archive.files if key != without}
    np.savez(path, **kept)


@pytest.mark.parametrize("missing", ["plan_path", "gains_shape", "c"])
def test_a_field_that_the_format_requires_is_named(bundle, tmp_path, missing):
    save_bundle(tmp_path, with_plans(bundle), "card")
    rewrite(tmp_path, without=missing)
    with pytest.raises(ArtifactError, match=f"expected a field '{missing}'"):
        load_bundle(tmp_path)


def test_parts_that_do_not_fit_are_not_written(bundle, tmp_path):
    with pytest.raises(ArtifactError, match="shape of B_uc"):
        save_bundle(tmp_path / "model", replace(bundle, B_uc=bundle.B_uc[:, :2]), "card")
    assert not (tmp_path / "model").exists()


def test_growth_and_radius_are_stored_in_the_file(bundle, folder):
    with np.load(folder / "koopman.npz") as archive:
        assert float(archive["spectral_radius"]) == pytest.approx(
            max(abs(np.linalg.eigvals(bundle.A)))
        )
        assert float(archive["growth_80"]) == pytest.approx(bundle.growth(80))
        assert float(archive["growth_20"]) == pytest.approx(bundle.growth(20))


@pytest.mark.parametrize("missing", ["encoder.onnx", "koopman.npz"])
def test_a_missing_file_is_named(folder, missing):
    (folder / missing).unlink()
    with pytest.raises(ArtifactError, match=missing) as error:
        load_bundle(folder)
    assert "offline-export" in str(error.value)


@pytest.mark.parametrize("length", [0, 10, 500])
def test_a_truncated_archive_is_refused(folder, length):
    path = folder / "koopman.npz"
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(ArtifactError, match="truncated"):
        load_bundle(folder)


def test_an_altered_encoder_is_refused(folder):
    (folder / "encoder.onnx").write_bytes(b"another encoder")
    with pytest.raises(ArtifactError, match="SHA-256"):
        load_bundle(folder)


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


def test_the_hash_is_stored_in_the_file(bundle, folder):
    with np.load(folder / "koopman.npz") as archive:
        assert str(archive["bundle_sha256"]) == bundle.sha256
