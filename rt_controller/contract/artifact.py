"""The model bundle: the one thing that training hands to the vehicle.

A folder of three files:

- `encoder.onnx`: physical x (batch, 6) float32, named "x" -> psi (batch, n) float32, named "psi",
  whose first six entries are x itself;
- `koopman.npz`: psi+ = A psi + B_uc u_c + B_uw kappa + c, all in physical units, with the
  names, units and period they hold for, what the lift needs, how the model grows, how it was
  trained, the SHA-256 of the encoder and a few pairs (x, psi) for a self-test;
- `card.md`: for people.

Only numpy and the standard library: a bundle can be made and read anywhere.
Paper: eqs. (6)-(8) and (14).
"""

import hashlib
import os
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import (
    EXOGENOUS_FIELDS,
    EXOGENOUS_UNITS,
    INPUT_UNITS,
    STATE_UNITS,
    ControlInput,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S

Array = NDArray[np.float64]

FORMAT_VERSION = 1
ENCODER_FILE = "encoder.onnx"
KOOPMAN_FILE = "koopman.npz"
CARD_FILE = "card.md"
LIFT_INPUTS = ("x",)
N_STATES = len(VehicleState._fields)

_EXPECTED_NAMES = {
    "state_fields": VehicleState._fields,
    "state_units": STATE_UNITS,
    "input_fields": ControlInput._fields,
    "input_units": INPUT_UNITS,
    "exogenous_fields": EXOGENOUS_FIELDS,
    "exogenous_units": EXOGENOUS_UNITS,
    "lift_inputs": LIFT_INPUTS,
}


@dataclass(frozen=True, slots=True)
class Bundle:
    """A lifted linear model in physical units, with the encoder that lifts into it.

    `n` is the number of observables, six physical states first.
    """

    name: str
    """what kind of model, for summaries: "mdk-net", "lti" """
    A: Array
    """(n, n)"""
    B_uc: Array
    """(n, 3), columns as `ControlInput`"""
    B_uw: Array
    """(n, 1), column: curvature in 1/m"""
    c: Array
    """(n,), the constant that centring left behind"""
    encoder_onnx: bytes
    selftest_x: Array
    """(m, 6) physical states"""
    selftest_psi: Array
    """(m, n) what the encoder made of them where it was trained"""
    training: str
    """resolved training configuration, JSON"""
    data_sha256: str
    """hash of the data set it was trained on"""
    dt_s: float = PERIOD_S

    @property
    def n_observables(self) -> int:
        return int(self.A.shape[0])

    @property
    def encoder_sha256(self) -> str:
        return hashlib.sha256(self.encoder_onnx).hexdigest()

    @property
    def spectral_radius(self) -> float:
        return float(np.max(np.abs(np.linalg.eigvals(self.A))))

    def growth(self, steps: int) -> float:
        """||A^steps||_2: how much an error may have grown after so many steps.

        Judged with every observable in units of its own spread over the self-test states, since
        a norm over metres, radians and latents together means nothing.
        """
        spread = self.selftest_psi.std(axis=0)
        scale = np.where(spread > 1e-9, spread, 1.0)
        scaled = self.A * scale[None, :] / scale[:, None]
        return float(np.linalg.norm(np.linalg.matrix_power(scaled, steps), 2))


def save_bundle(folder: Path, bundle: Bundle, card: str) -> None:
    """Write the three files; an existing bundle is replaced file by file, each atomically."""
    folder.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, Any] = {
        "format_version": np.int64(FORMAT_VERSION),
        "name": np.str_(bundle.name),
        "A": bundle.A,
        "B_uc": bundle.B_uc,
        "B_uw": bundle.B_uw,
        "c": bundle.c,
        "dt_s": np.float64(bundle.dt_s),
        "spectral_radius": np.float64(bundle.spectral_radius),
        "growth_20": np.float64(bundle.growth(20)),
        "growth_80": np.float64(bundle.growth(80)),
        "training": np.str_(bundle.training),
        "data_sha256": np.str_(bundle.data_sha256),
        "encoder_sha256": np.str_(bundle.encoder_sha256),
        "selftest_x": bundle.selftest_x,
        "selftest_psi": bundle.selftest_psi,
        **{key: np.array(names) for key, names in _EXPECTED_NAMES.items()},
    }
    _replace(folder / ENCODER_FILE, lambda path: path.write_bytes(bundle.encoder_onnx))
    _replace(folder / KOOPMAN_FILE, lambda path: _write_npz(path, arrays))
    _replace(folder / CARD_FILE, lambda path: path.write_text(card, encoding="utf-8"))


def load_bundle(folder: Path) -> Bundle:
    """Read a bundle and check everything that can be checked without running the encoder.

    Raises:
        ArtifactError: a file is missing, truncated or altered, or the bundle was made for other
            signals, another period or another format.
    """
    arrays = _read_npz(folder / KOOPMAN_FILE)
    _check_field(
        folder, "format_version", FORMAT_VERSION, int(_take(folder, arrays, "format_version"))
    )
    for key, names in _EXPECTED_NAMES.items():
        _check_field(folder, key, names, tuple(str(name) for name in _take(folder, arrays, key)))
    _check_field(folder, "dt_s", PERIOD_S, float(_take(folder, arrays, "dt_s")))

    bundle = Bundle(
        name=str(_take(folder, arrays, "name")),
        A=_matrix(folder, arrays, "A"),
        B_uc=_matrix(folder, arrays, "B_uc"),
        B_uw=_matrix(folder, arrays, "B_uw"),
        c=_matrix(folder, arrays, "c"),
        encoder_onnx=_read_encoder(folder / ENCODER_FILE),
        selftest_x=_matrix(folder, arrays, "selftest_x"),
        selftest_psi=_matrix(folder, arrays, "selftest_psi"),
        training=str(_take(folder, arrays, "training")),
        data_sha256=str(_take(folder, arrays, "data_sha256")),
    )
    n = bundle.A.shape[0]
    m = bundle.selftest_x.shape[0]
    shapes = {
        "A": (n, n),
        "B_uc": (n, len(ControlInput._fields)),
        "B_uw": (n, len(EXOGENOUS_FIELDS)),
        "c": (n,),
        "selftest_x": (m, N_STATES),
        "selftest_psi": (m, n),
    }
    for key, shape in shapes.items():
        _check_field(folder, f"shape of {key}", shape, getattr(bundle, key).shape)
    if n < N_STATES or m < 1:
        raise ArtifactError(
            f"{folder / KOOPMAN_FILE}: expected at least {N_STATES} observables and one self-test "
            f"pair, found {n} and {m}. Run offline-export again."
        )
    expected_sha = str(_take(folder, arrays, "encoder_sha256"))
    if bundle.encoder_sha256 != expected_sha:
        raise ArtifactError(
            f"{folder / ENCODER_FILE}: expected SHA-256 {expected_sha[:16]}…, found "
            f"{bundle.encoder_sha256[:16]}…: the two files are not of one export, or the encoder "
            f"was altered. Run offline-export again."
        )
    return bundle


def _matrix(folder: Path, arrays: dict[str, Any], key: str) -> Array:
    array = _take(folder, arrays, key)
    if array.dtype != np.float64 or not np.all(np.isfinite(array)):
        raise ArtifactError(
            f"{folder / KOOPMAN_FILE}: expected finite float64 numbers in {key}, found "
            f"{array.dtype} with {np.count_nonzero(~np.isfinite(array))} not finite. "
            f"Run offline-export again."
        )
    return np.ascontiguousarray(array)


def _take(folder: Path, arrays: dict[str, Any], key: str) -> Any:
    if key not in arrays:
        raise ArtifactError(
            f"{folder / KOOPMAN_FILE}: expected a field {key!r}, found {sorted(arrays)}. "
            f"Run offline-export again."
        )
    return arrays[key]


def _check_field(folder: Path, key: str, expected: object, found: object) -> None:
    if expected != found:
        raise ArtifactError(
            f"{folder / KOOPMAN_FILE}: expected {key} = {expected}, found {found}. This bundle was "
            f"made for another controller: run offline-export of the same version."
        )


def _read_encoder(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ArtifactError(
            f"{path}: expected the encoder of a model bundle, found nothing readable "
            f"({error.strerror}). Point --model at a folder that offline-export wrote."
        ) from error


def _read_npz(path: Path) -> dict[str, Any]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {key: archive[key] for key in archive.files}
    except FileNotFoundError as error:
        raise ArtifactError(
            f"{path}: expected the matrices of a model bundle, found no such file. Point --model "
            f"at a folder that offline-export wrote."
        ) from error
    except (OSError, ValueError, EOFError, KeyError, AttributeError, zipfile.BadZipFile) as error:
        raise ArtifactError(
            f"{path}: expected an npz archive without pickles, found something else or a truncated "
            f"file ({error}). Run offline-export again."
        ) from error


def _write_npz(path: Path, arrays: dict[str, Any]) -> None:
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def _replace(path: Path, write: Any) -> None:
    """A reader sees the old file or the new one, never half of one."""
    part = path.with_name(path.name + ".part")
    write(part)
    os.replace(part, path)
