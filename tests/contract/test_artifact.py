"""A bundle is what it says it is, or it is refused with expected, found, remedy."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

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


def test_a_saved_bundle_loads_equal(bundle: Bundle, folder: Path) -> None:
    loaded = load_bundle(folder)
    for field in ("A", "B_uc", "B_uw", "c", "selftest_x", "selftest_psi"):
        np.testing.assert_array_equal(getattr(loaded, field), getattr(bundle, field))
    assert loaded.encoder_onnx == bundle.encoder_onnx
    assert (loaded.name, loaded.training, loaded.data_sha256) == ("random", "{}", "0" * 64)
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
    ],
)
def test_a_bundle_for_another_controller_is_refused(
    folder: Path, field: str, value: object, message: str
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
