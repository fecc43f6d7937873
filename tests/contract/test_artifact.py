"""A bundle is what it says it is, or it is refused with expected, found, remedy."""

import random
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rt_controller.contract.artifact import Bundle, load_bundle, save_bundle
from rt_controller.contract.errors import ArtifactError


@pytest.fixture
def bundle() -> Bundle:
    rng = np.random.default_rng(1)
    n = 9
    return Bundle(
        name="random",
        A=np.eye(n) + 0.01 * rng.normal(size=(n, n)),
        B_uc=rng.normal(size=(n, 3)),
        B_uw=rng.normal(size=(n, 1)),
        c=rng.normal(size=n),
        encoder_onnx=b"not run here",
        selftest_x=rng.normal(size=(4, 6)),
        selftest_psi=rng.normal(size=(4, n)),
        training="{}",
        data_sha256="0" * 64,
    )


@pytest.fixture
def folder(bundle: Bundle, tmp_path: Path) -> Path:
    save_bundle(tmp_path, bundle, "# a card\n")
    return tmp_path


def rewrite(folder: Path, **changes: object) -> None:
    """The npz with some fields replaced (or, given None, removed)."""
    path = folder / "koopman.npz"
    with np.load(path) as archive:
        fields = {key: archive[key] for key in archive.files}
    fields.update(changes)
    np.savez(path, **{key: value for key, value in fields.items() if value is not None})


def equal(one: Bundle, other: Bundle) -> bool:
    return all(
        np.array_equal(getattr(one, field.name), getattr(other, field.name))
        for field in fields(Bundle)
    )


def test_a_saved_bundle_loads_equal(bundle: Bundle, folder: Path) -> None:
    assert equal(load_bundle(folder), bundle)
    assert (folder / "card.md").read_text() == "# a card\n"


def test_growth_and_radius_are_written_for_others_to_read(bundle: Bundle, folder: Path) -> None:
    with np.load(folder / "koopman.npz") as archive:
        assert float(archive["spectral_radius"]) == pytest.approx(
            max(abs(np.linalg.eigvals(bundle.A)))
        )
        assert float(archive["growth_80"]) == pytest.approx(bundle.growth(80))
        assert float(archive["growth_20"]) == pytest.approx(bundle.growth(20))


def test_growth_does_not_depend_on_the_units_of_an_observable(bundle: Bundle) -> None:
    units = np.array([3.6, 1.0, 57.3, 1000.0, 1.0, 57.3, 1.0, 20.0, 0.1])
    other = replace(
        bundle,
        A=bundle.A * units[:, None] / units[None, :],
        selftest_psi=bundle.selftest_psi * units,
    )
    assert other.growth(20) == pytest.approx(bundle.growth(20))


def test_an_observable_is_measured_by_its_spread_and_a_constant_by_its_size(
    bundle: Bundle,
) -> None:
    psi = bundle.selftest_psi.copy()
    psi[:, 6] *= 1e-3
    psi[:, 7] = -3.0
    psi[:, 8] = 0.0
    spread = replace(bundle, selftest_psi=psi).spread
    np.testing.assert_array_equal(spread[:7], psi[:, :7].std(axis=0))
    np.testing.assert_array_equal(spread[7:], [3.0, 1.0])


def test_parity_counts_a_small_latent_like_any_other(bundle: Bundle) -> None:
    psi = bundle.selftest_psi.copy()
    psi[:, 8] *= 1e-4
    small = replace(bundle, selftest_psi=psi)
    lifted = psi.copy()
    assert small.parity_error(lifted) == 0.0
    lifted[2, 8] += 0.01 * small.spread[8]
    assert small.parity_error(lifted) == pytest.approx(0.01)
    lifted[0, 0] = np.nan
    assert np.isnan(small.parity_error(lifted))


@pytest.mark.parametrize("missing", ["encoder.onnx", "koopman.npz"])
def test_a_missing_file_is_named(folder: Path, missing: str) -> None:
    (folder / missing).unlink()
    with pytest.raises(ArtifactError, match=missing) as error:
        load_bundle(folder)
    assert "offline-export" in str(error.value)


@pytest.mark.parametrize("length", [0, 10, 500])
def test_a_truncated_archive_is_refused(folder: Path, length: int) -> None:
    path = folder / "koopman.npz"
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(ArtifactError, match="truncated"):
        load_bundle(folder)


def test_an_altered_encoder_is_refused(folder: Path) -> None:
    (folder / "encoder.onnx").write_bytes(b"another encoder")
    with pytest.raises(ArtifactError, match="SHA-256"):
        load_bundle(folder)


def with_a_flipped_bit(whole: bytes, seed: int) -> bytes:
    dice = random.Random(seed)
    place = dice.randrange(len(whole))
    flipped = bytearray(whole)
    flipped[place] ^= 1 << dice.randrange(8)
    return bytes(flipped)


def unless_refused(folder: Path) -> Bundle | None:
    try:
        return load_bundle(folder)
    except ArtifactError:
        return None


def test_a_flipped_bit_in_the_matrices_is_refused_or_makes_no_difference(
    bundle: Bundle, folder: Path
) -> None:
    """No difference: dates and other things that an archive says beside its content."""
    path = folder / "koopman.npz"
    whole = path.read_bytes()
    loaded = []
    for seed in range(400):
        path.write_bytes(with_a_flipped_bit(whole, seed))
        loaded.append(unless_refused(folder))
    assert all(found is None or equal(found, bundle) for found in loaded)
    assert 200 < loaded.count(None) < 400


def test_a_flipped_bit_in_the_encoder_is_refused(bundle: Bundle, folder: Path) -> None:
    encoder = bytes(random.Random(0).randbytes(2000))
    save_bundle(folder, replace(bundle, encoder_onnx=encoder), "card")
    for seed in range(100):
        (folder / "encoder.onnx").write_bytes(with_a_flipped_bit(encoder, seed))
        with pytest.raises(ArtifactError, match="SHA-256"):
            load_bundle(folder)


@pytest.mark.parametrize("key", ["A", "B_uc", "B_uw", "c"])
def test_an_altered_matrix_is_refused(bundle: Bundle, folder: Path, key: str) -> None:
    rewrite(folder, **{key: 0.9 * getattr(bundle, key)})
    with pytest.raises(ArtifactError, match="expected the model of SHA-256"):
        load_bundle(folder)


def test_a_model_is_known_by_every_number_it_predicts_with(bundle: Bundle) -> None:
    others = [
        replace(bundle, **{key: 0.9 * getattr(bundle, key)}) for key in ("A", "B_uc", "B_uw", "c")
    ]
    others += [replace(bundle, encoder_onnx=b"another"), replace(bundle, name="another")]
    assert len({bundle.sha256, *(other.sha256 for other in others)}) == 7


def test_a_model_is_not_known_by_how_it_was_trained_or_stored(bundle: Bundle) -> None:
    stored = np.asfortranarray(bundle.A)
    other = replace(bundle, A=stored, training='{"seed": 1}', data_sha256="1" * 64)
    assert other.sha256 == bundle.sha256


def test_a_hash_is_stored_for_others_to_read(bundle: Bundle, folder: Path) -> None:
    with np.load(folder / "koopman.npz") as archive:
        assert str(archive["bundle_sha256"]) == bundle.sha256


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("state_fields", np.array(["vy_mps", "vx_mps"]), "state_fields"),
        ("state_units", np.array(["km/h", "m/s", "rad/s", "m", "m", "rad"]), "state_units"),
        ("input_fields", np.array(["brake_n", "throttle", "steer_rad"]), "input_fields"),
        ("lift_inputs", np.array(["x", "history"]), "lift_inputs"),
        ("dt_s", np.float64(0.024), "dt_s"),
        ("format_version", np.int64(99), "format_version"),
        ("A", np.ones((9, 8)), "shape of A"),
        ("A", np.full((9, 9), np.nan), "finite"),
        ("B_uc", np.zeros((9, 4)), "shape of B_uc"),
        ("c", None, "'c'"),
        ("bundle_sha256", None, "'bundle_sha256'"),
        ("format_version", np.str_("one"), "format_version = 1, found one"),
        ("format_version", np.str_("1"), "format_version"),
        ("format_version", np.array([1]), "format_version"),
        ("format_version", np.eye(2), "format_version"),
        ("dt_s", np.str_("fast"), "dt_s = 0.025, found fast"),
        ("dt_s", np.array([0.025, 0.025]), "dt_s"),
        ("dt_s", np.float64(np.nan), "dt_s"),
        ("state_fields", np.str_("vx_mps"), "state_fields"),
        ("lift_inputs", np.str_("x"), "lift_inputs"),
        ("input_fields", np.arange(3.0), "input_fields"),
        ("A", np.str_("a matrix"), "numbers in 2 dimensions in A, found <U8"),
        ("A", np.array([["a", "b"]]), "numbers in 2 dimensions in A"),
        ("A", np.float64(1.0), "numbers in 2 dimensions in A"),
        ("A", np.eye(9, dtype=np.float32), "float64 numbers"),
        ("A", np.eye(9, dtype=np.complex128), "float64 numbers"),
        ("A", np.zeros((0, 0)), "shape of B_uc"),
        ("c", np.ones((9, 1)), "numbers in 1 dimensions in c"),
        ("selftest_x", np.zeros((0, 6)), "shape of selftest_psi"),
        ("selftest_psi", np.float64(0.0), "selftest_psi"),
        ("name", np.array(["a", "list"]), "one text in name"),
        ("training", np.float64(1.0), "one text in training"),
        ("data_sha256", np.zeros(3), "one text in data_sha256"),
        ("encoder_sha256", np.int64(0), "one text in encoder_sha256"),
        ("bundle_sha256", np.zeros(64), "one text in bundle_sha256"),
    ],
)
def test_a_bundle_for_another_controller_is_refused(
    folder: Path, field: str, value: NDArray[np.generic] | None, message: str
) -> None:
    rewrite(folder, **{field: value})
    with pytest.raises(ArtifactError, match=message) as error:
        load_bundle(folder)
    assert "expected" in str(error.value)
    assert "found" in str(error.value)


def test_pickles_are_never_opened(folder: Path) -> None:
    rewrite(folder, c=np.array([{"a": "pickle"}], dtype=object))
    with pytest.raises(ArtifactError, match="pickles"):
        load_bundle(folder)


@pytest.mark.parametrize(
    "content", [b"PK\x03\x04", b"\x93NUMPY", b"text", b"PK\x05\x06" + bytes(18)]
)
def test_what_is_no_bundle_is_refused(folder: Path, content: bytes) -> None:
    (folder / "koopman.npz").write_bytes(content)
    with pytest.raises(ArtifactError, match="expected"):
        load_bundle(folder)


def test_a_folder_in_place_of_a_file_is_refused(folder: Path) -> None:
    (folder / "koopman.npz").unlink()
    (folder / "koopman.npz").mkdir()
    with pytest.raises(ArtifactError, match="nothing readable"):
        load_bundle(folder)
