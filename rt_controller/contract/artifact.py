"""The model bundle: the one thing that training hands to the vehicle.

A folder of three files:

- `encoder.onnx`: physical x (batch, 6) float32, named "x" -> psi (batch, n) float32, named "psi",
  whose first six entries are x itself;
- `koopman.npz`: psi+ = A psi + B_uc u_c + B_uw kappa + c, all in physical units, with the
  names, units and period they hold for, what the lift needs, how the model grows, how it was
  trained, the SHA-256 of the encoder and of the whole model, and a few pairs (x, psi) for a
  self-test;
- `card.md`: for people.

Only numpy and the standard library: a bundle can be made and read anywhere.
Paper: eqs. (6)-(8) and (14).
"""

import hashlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.koopman_file import check_field, read_koopman
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

SMALLEST_SPREAD = 1e-6
"""of an observable, as a share of its size: below, float32 cannot tell it from a constant"""

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
    def sha256(self) -> str:
        """What the model is known by: it changes with every number that a prediction follows from.

        Over name, period, encoder and matrices; not over how the model was trained and is tested.
        """
        digest = hashlib.sha256()
        digest.update(f"{self.name}\n{self.dt_s!r}\n{self.encoder_sha256}\n".encode())
        for key in ("A", "B_uc", "B_uw", "c"):
            array = np.ascontiguousarray(getattr(self, key), dtype="<f8")
            digest.update(f"{key} {array.shape}\n".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    @property
    def spectral_radius(self) -> float:
        return float(np.max(np.abs(np.linalg.eigvals(self.A))))

    @property
    def spread(self) -> Array:
        """(n,) standard deviation of each observable over the self-test states.

        What counts as much or little of an observable, since metres, radians and latents share no
        unit. A constant is measured by its size instead, and by 1 if it is zero.
        """
        spread = self.selftest_psi.std(axis=0)
        size = np.abs(self.selftest_psi).max(axis=0)
        return np.where(spread > SMALLEST_SPREAD * size, spread, np.where(size > 0.0, size, 1.0))

    def growth(self, steps: int) -> float:
        """||A^steps||_2: how much an error may have grown, in units of `spread`, after `steps`."""
        scale = self.spread
        scaled = self.A * scale[None, :] / scale[:, None]
        return float(np.linalg.norm(np.linalg.matrix_power(scaled, steps), 2))

    def parity_error(self, psi: Array) -> float:
        """Largest difference between psi (m, n), lifted from the self-test states, and the stored.

        In units of `spread`; not a number if one of psi is none.
        """
        return float(np.max(np.abs(psi - self.selftest_psi) / self.spread))


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
        "bundle_sha256": np.str_(bundle.sha256),
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
    koopman = read_koopman(folder / KOOPMAN_FILE)
    koopman.require("format_version", FORMAT_VERSION)
    for key, names in _EXPECTED_NAMES.items():
        koopman.require(key, names)
    koopman.require("dt_s", PERIOD_S)

    bundle = Bundle(
        name=koopman.text("name"),
        A=koopman.numbers("A", 2),
        B_uc=koopman.numbers("B_uc", 2),
        B_uw=koopman.numbers("B_uw", 2),
        c=koopman.numbers("c", 1),
        encoder_onnx=_read_encoder(folder / ENCODER_FILE),
        selftest_x=koopman.numbers("selftest_x", 2),
        selftest_psi=koopman.numbers("selftest_psi", 2),
        training=koopman.text("training"),
        data_sha256=koopman.text("data_sha256"),
    )
    _check_shapes(folder / KOOPMAN_FILE, bundle)
    _check_hash(
        folder / ENCODER_FILE, koopman.text("encoder_sha256"), bundle.encoder_sha256, "encoder"
    )
    _check_hash(folder / KOOPMAN_FILE, koopman.text("bundle_sha256"), bundle.sha256, "model")
    return bundle


def _check_shapes(path: Path, bundle: Bundle) -> None:
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
        check_field(path, f"shape of {key}", shape, getattr(bundle, key).shape)
    if n < N_STATES or m < 1:
        raise ArtifactError(
            f"{path}: expected at least {N_STATES} observables and one self-test pair, found {n} "
            f"and {m}. Run offline-export again."
        )


def _check_hash(path: Path, expected: str, found: str, what: str) -> None:
    if found != expected:
        raise ArtifactError(
            f"{path}: expected the {what} of SHA-256 {expected:.16}…, found {found:.16}…: the two "
            f"files are not of one export, or one was altered. Run offline-export again."
        )


def _read_encoder(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ArtifactError(
            f"{path}: expected the encoder of a model bundle, found nothing readable "
            f"({error.strerror}). Point --model at a folder that offline-export wrote."
        ) from error


def _write_npz(path: Path, arrays: dict[str, Any]) -> None:
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def _replace(path: Path, write: Callable[[Path], object]) -> None:
    """A reader sees the old file or the new one, never half of one."""
    part = path.with_name(path.name + ".part")
    write(part)
    os.replace(part, path)
