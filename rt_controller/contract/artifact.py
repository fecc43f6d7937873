"""A model bundle on disk: a folder of three files.

- `encoder.onnx`: what `Lift` says the encoder is shown -> psi (batch, n) float32, named "psi",
  whose first entries are the states themselves;
- `koopman.npz`: psi+ = A psi + B_uc u_c + B_uw w + c, all in physical units, with the names, units
  and period they hold for, what the input matrix adds where it follows psi_0, what the lift needs,
  how the model grows, how it was trained, the SHA-256 of the encoder and of the whole model, and a
  few pairs (x, w, history; psi) for a self-test;
- `card.md`: for people.

Only numpy and the standard library: a bundle can be made and read anywhere.
Paper: eqs. (6)-(8) and (14).
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from rt_controller.contract.bilinear import Bilinear
from rt_controller.contract.bundle import Array, Bundle
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.fitness import require_fitting_parts
from rt_controller.contract.follow import Follow
from rt_controller.contract.koopman_file import KoopmanFile, check_field, read_koopman
from rt_controller.contract.lift import Lift, LiftSample
from rt_controller.contract.schema import Schema, Signal

__all__ = [
    "Array",
    "Bilinear",
    "Bundle",
    "Lift",
    "LiftSample",
    "load_bundle",
    "save_bundle",
]

FORMAT_VERSION = 2
ENCODER_FILE = "encoder.onnx"
KOOPMAN_FILE = "koopman.npz"
CARD_FILE = "card.md"


def save_bundle(folder: Path, bundle: Bundle, card: str) -> None:
    """Write the three files; an existing bundle is replaced file by file, each atomically.

    Raises:
        ArtifactError: the parts of the bundle do not fit each other; nothing is written.
    """
    require_fitting_parts(bundle, folder / KOOPMAN_FILE)
    folder.mkdir(parents=True, exist_ok=True)
    _replace(folder / ENCODER_FILE, lambda path: path.write_bytes(bundle.encoder_onnx))
    _replace(folder / KOOPMAN_FILE, lambda path: _write_npz(path, _arrays_of(bundle)))
    _replace(folder / CARD_FILE, lambda path: path.write_text(card, encoding="utf-8"))


def load_bundle(folder: Path) -> Bundle:
    """Read a bundle of any signals and check all that can be checked without running the encoder.

    Raises:
        ArtifactError: a file is missing, truncated or altered, of another format, or its parts do
            not fit each other.
    """
    koopman = read_koopman(folder / KOOPMAN_FILE)
    koopman.require("format_version", FORMAT_VERSION)
    bundle = Bundle(
        name=koopman.text("name"),
        schema=_read_schema(koopman),
        A=koopman.numbers("A", 2),
        B_uc=koopman.numbers("B_uc", 2),
        B_uw=koopman.numbers("B_uw", 2),
        c=koopman.numbers("c", 1),
        bilinear=_read_bilinear(koopman),
        lift=_read_lift(koopman),
        encoder_onnx=_read_encoder(folder / ENCODER_FILE),
        selftest=LiftSample(
            x=koopman.numbers("selftest_x", 2),
            w=koopman.numbers("selftest_w", 2),
            history=koopman.numbers("selftest_history", 3),
        ),
        selftest_psi=koopman.numbers("selftest_psi", 2),
        training=koopman.text("training"),
        data_sha256=koopman.text("data_sha256"),
    )
    require_fitting_parts(bundle, koopman.path)
    _check_hash(
        folder / ENCODER_FILE, koopman.text("encoder_sha256"), bundle.encoder_sha256, "encoder"
    )
    _check_hash(koopman.path, koopman.text("bundle_sha256"), bundle.sha256, "model")
    return bundle


def _arrays_of(bundle: Bundle) -> dict[str, Any]:
    n, m = bundle.n_observables, bundle.B_uc.shape[1]
    nothing = Bilinear(np.zeros((0, n, m)), np.zeros((0, m, n)), np.zeros((0, m)))
    bilinear = bundle.bilinear or nothing
    return {
        "format_version": np.int64(FORMAT_VERSION),
        "name": np.str_(bundle.name),
        **_signal_arrays("state", bundle.schema.states),
        **_signal_arrays("input", bundle.schema.inputs),
        **_signal_arrays("exogenous", bundle.schema.exogenous),
        "dt_s": np.float64(bundle.schema.dt_s),
        "lift_inputs": _words(bundle.lift.inputs),
        "history_steps": np.int64(bundle.lift.history_steps),
        "history_fields": _words(bundle.lift.history_fields),
        "A": bundle.A,
        "B_uc": bundle.B_uc,
        "B_uw": bundle.B_uw,
        "c": bundle.c,
        "bilinear_N": bilinear.N,
        "bilinear_S": bilinear.S,
        "bilinear_s0": bilinear.s0,
        "bilinear_follows": np.str_(bilinear.follows),
        "spectral_radius": np.float64(bundle.spectral_radius),
        "growth_20": np.float64(bundle.growth(20)),
        "growth_80": np.float64(bundle.growth(80)),
        "training": np.str_(bundle.training),
        "data_sha256": np.str_(bundle.data_sha256),
        "encoder_sha256": np.str_(bundle.encoder_sha256),
        "bundle_sha256": np.str_(bundle.sha256),
        "selftest_x": bundle.selftest.x,
        "selftest_w": bundle.selftest.w,
        "selftest_history": bundle.selftest.history,
        "selftest_psi": bundle.selftest_psi,
    }


def _signal_arrays(kind: str, signals: tuple[Signal, ...]) -> dict[str, Any]:
    return {
        f"{kind}_fields": _words(tuple(signal.name for signal in signals)),
        f"{kind}_units": _words(tuple(signal.unit for signal in signals)),
    }


def _words(words: tuple[str, ...]) -> Any:
    return np.array(words, dtype=np.str_)


def _read_schema(koopman: KoopmanFile) -> Schema:
    return Schema(
        states=_read_signals(koopman, "state"),
        inputs=_read_signals(koopman, "input"),
        exogenous=_read_signals(koopman, "exogenous"),
        dt_s=koopman.number("dt_s"),
    )


def _read_signals(koopman: KoopmanFile, kind: str) -> tuple[Signal, ...]:
    names, units = koopman.words(f"{kind}_fields"), koopman.words(f"{kind}_units")
    check_field(koopman.path, f"number of {kind}_units", len(names), len(units))
    return tuple(map(Signal, names, units))


def _read_lift(koopman: KoopmanFile) -> Lift:
    return Lift(
        inputs=koopman.words("lift_inputs"),
        history_steps=koopman.count("history_steps"),
        history_fields=koopman.words("history_fields"),
    )


def _read_bilinear(koopman: KoopmanFile) -> Bilinear | None:
    N, S = koopman.numbers("bilinear_N", 3), koopman.numbers("bilinear_S", 3)
    s0 = koopman.numbers("bilinear_s0", 2)
    follows = koopman.text("bilinear_follows")
    if follows not in list(Follow):
        check_field(koopman.path, "bilinear_follows", " or ".join(Follow), follows)
    if not max(len(N), len(S), len(s0)):
        return None
    return Bilinear(N, S, s0, Follow(follows))


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
