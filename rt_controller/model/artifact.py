"""A model bundle on disk: a folder of three files.

- `encoder.onnx`: from the inputs that `Lift` names to "psi" (batch, n) float32, whose first entries
  are the states themselves;
- `koopman.npz`: psi+ = A psi + B_uc u_c + B_uw w + c + gains, all in physical units, with the
  names, units and period of the signals, the inputs of the lift, the growth of the model, its
  training configuration, the SHA-256 of the encoder and of the whole model, a few pairs (x, w,
  history; psi) for a self-test, the geometry of the car's steering where it is known, and
  the ranges of the training data;
- `card.md`: for people.

Paper: eqs. (6)-(8) and (14).
"""

import json
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.car import Car, car_of
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.files import (
    DamagedArchiveError,
    atomic_write,
    open_regular,
    read_arrays,
)
from rt_controller.contract.limits import SteeringGeometry
from rt_controller.contract.names import MODEL_FOLDER, name_or
from rt_controller.contract.signals import Schema, Signal
from rt_controller.model.bundle import Bundle, PlanSample
from rt_controller.model.dynamics import Gains, no_gains
from rt_controller.model.follow import Follow
from rt_controller.model.lift import Lift, LiftSample
from rt_controller.model.path_kinematics import Movement
from rt_controller.model.validation import check_field, require_fitting_parts
from rt_controller.model.validity import Validity

SHIPPED_MODEL = "mdk-net"
"""the model that drives if none is chosen"""

FORMAT_VERSION = 5
LARGEST_FILE_BYTES = 64_000_000
LARGEST_UNPACKED_BYTES = 256_000_000
"""a hundred times the shipped models"""
ENCODER_FILE = "encoder.onnx"
KOOPMAN_FILE = "koopman.npz"
CARD_FILE = "card.md"

UNCHANGED = ("name", "A", "B_uc", "B_uw", "c", "selftest_psi", "training", "data_sha256")
"""fields of `koopman.npz` that are attributes of `Bundle` of the same name"""
SIGNALS = {"state": "states", "input": "inputs", "exogenous": "exogenous"}
"""beginning of the fields that describe signals, and the attribute of `Schema`"""


def _table(text: str) -> dict[str, tuple[str, int]]:
    """Kind of numpy type (U, i, f) and number of dimensions of each field in lines of text."""
    rows = (line.split() for line in text.strip().splitlines())
    return {name: (kind[0], int(kind[1])) for kind, *names in rows for name in names}


FIELDS = _table("""
    U0 name training data_sha256 encoder_sha256 bundle_sha256 gains_follows
    U1 state_fields input_fields exogenous_fields state_units input_units exogenous_units
    U1 lift_inputs history_fields
    i0 history_steps
    i1 gains_factor gains_shape
    f0 dt_s
    f1 c gains_s0
    f2 A B_uc B_uw gains_N gains_S selftest_x selftest_w selftest_psi
    f3 selftest_history
""")
"""each field that is read"""
OPTIONAL = {
    **dict.fromkeys(SteeringGeometry._fields, ("f", 0)),
    "car": ("U", 0),
    "signal_range": ("f", 2),
}
"""fields that a bundle need not have"""
GROUPS = tuple(
    map(
        _table,
        (
            """
            f1 plan_curvature_per_m
            f2 plan_state plan_path plan_previous
            f3 plan_inputs
            """,
            """
            f1 movement_s0
            f2 movement_S
            """,
            """
            f1 valid_speed_mps valid_lateral_mps2 valid_steer_rad valid_curvature_per_m
            f2 valid_conditions
            """,
        ),
    )
)
"""fields of which a bundle has all or none"""


def shipped_model(name: str = SHIPPED_MODEL) -> Path:
    """The folder of a bundle that ships with the package: "mdk-net", "mdk-net-paper" or "lti"."""
    return Path(str(resources.files("rt_controller") / "models" / name))


def find_model(model: str | Path | None) -> Path:
    """The folder of a model: the shipped one of that name, otherwise the path, if it exists."""
    if model is None:
        return shipped_model()
    shipped = shipped_model(str(model))
    if Path(model).name == str(model) and shipped.is_dir():
        return shipped
    if not Path(model).exists():
        names = sorted(folder.name for folder in shipped_model().parent.iterdir())
        raise ArtifactError(
            f"model {str(model)!r}: {name_or(Path(model).name, names, MODEL_FOLDER)}."
        )
    return Path(model)


def save_bundle(folder: Path, bundle: Bundle, card: str) -> None:
    """Write the three files, if the parts of the bundle fit each other; each atomically."""
    require_fitting_parts(bundle, folder / KOOPMAN_FILE)
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_write(folder / ENCODER_FILE) as file:
        file.write(bundle.encoder_onnx)
    with atomic_write(folder / KOOPMAN_FILE) as file:
        np.savez_compressed(file, **_fields_of(bundle))
    with atomic_write(folder / CARD_FILE) as file:
        file.write(card.encode())


def load_bundle(folder: Path) -> Bundle:
    """Read a bundle of any signals and check all that can be checked without running the encoder.

    Raises:
        ArtifactError: a file is missing, truncated or altered, of another format, or its parts do
            not fit each other.
    """
    path, encoder_path = folder / KOOPMAN_FILE, folder / ENCODER_FILE
    found = _read_fields(path)
    try:
        with open_regular(encoder_path, LARGEST_FILE_BYTES) as file:
            encoder = file.read()
    except OSError as error:
        raise _unreadable(encoder_path, "the encoder", error) from error
    lift = Lift("w" in found["lift_inputs"], found["history_steps"], found["history_fields"])
    check_field(path, "lift_inputs", lift.inputs, found["lift_inputs"])
    states, inputs, exogenous = (_signals(path, found, kind) for kind in SIGNALS)
    if found["gains_follows"] not in list(Follow):
        check_field(path, "gains_follows", " or ".join(Follow), found["gains_follows"])
    gains = _part(Gains, "gains", found)
    gains = gains._replace(follows=Follow(gains.follows))
    bundle = Bundle(
        schema=Schema(states, inputs, exogenous, found["dt_s"]),
        gains=gains if any(map(np.size, gains[:-1])) else None,
        movement=_part(Movement, "movement", found) if "movement_S" in found else None,
        lift=lift,
        car=_car(path, found),
        plans=_part(PlanSample, "plan", found) if "plan_state" in found else None,
        signal_range=found.get("signal_range"),
        validity=_part(Validity, "valid", found) if "valid_speed_mps" in found else None,
        encoder_onnx=encoder,
        selftest=_part(LiftSample, "selftest", found),
        **{name: found[name] for name in UNCHANGED},
    )
    require_fitting_parts(bundle, path)
    _check_hash(encoder_path, found["encoder_sha256"], bundle.encoder_sha256, "encoder")
    _check_hash(path, found["bundle_sha256"], bundle.sha256, "model")
    return bundle


def _fields_of(bundle: Bundle) -> dict[str, Any]:
    """The fields of `koopman.npz` by name, as numpy takes them."""
    parts = {
        "gains": bundle.gains or no_gains(bundle.n_observables),
        "selftest": bundle.selftest,
        "plan": bundle.plans,
        "movement": bundle.movement,
        "valid": bundle.validity,
    }
    signals = {kind: getattr(bundle.schema, name) for kind, name in SIGNALS.items()}
    texts = {
        **{f"{kind}_fields": [signal.name for signal in each] for kind, each in signals.items()},
        **{f"{kind}_units": [signal.unit for signal in each] for kind, each in signals.items()},
        "lift_inputs": bundle.lift.inputs,
        "history_fields": bundle.lift.history_fields,
    }
    return {
        "format_version": FORMAT_VERSION,
        **{name: getattr(bundle, name) for name in UNCHANGED},
        **{name: np.array(listed, dtype=np.str_) for name, listed in texts.items()},
        "dt_s": bundle.schema.dt_s,
        "history_steps": bundle.lift.history_steps,
        **{
            f"{kind}_{name}": value
            for kind, part in parts.items()
            if part is not None
            for name, value in part._asdict().items()
        },
        "spectral_radius": bundle.spectral_radius,
        "growth_20": bundle.growth(20),
        "growth_80": bundle.growth(80),
        "encoder_sha256": bundle.encoder_sha256,
        "bundle_sha256": bundle.sha256,
        **({} if bundle.car is None else bundle.car.geometry._asdict()),
        **({} if bundle.car is None else {"car": json.dumps(bundle.car.own_values)}),
        **({} if bundle.signal_range is None else {"signal_range": bundle.signal_range}),
    }


def _signals(path: Path, found: dict[str, Any], kind: str) -> tuple[Signal, ...]:
    names, units = found[f"{kind}_fields"], found[f"{kind}_units"]
    check_field(path, f"number of {kind}_units", len(names), len(units))
    return tuple(map(Signal, names, units))


def _part(kind: Any, name: str, found: dict[str, Any]) -> Any:
    """The NamedTuple `kind` of the fields that begin with `name`."""
    return kind(*(found[f"{name}_{field}"] for field in kind._fields))


def _car(path: Path, found: dict[str, Any]) -> Car | None:
    present = [name for name in SteeringGeometry._fields if name in found]
    if not present:
        return None
    needed = tuple(name for name in SteeringGeometry._fields if name != "lock_rad")
    check_field(path, "fields of the car", needed, tuple(n for n in present if n != "lock_rad"))
    try:
        own = json.loads(found.get("car", "{}"))
        return car_of({**{name: found[name] for name in present}, **own})
    except (ValueError, AttributeError, TypeError) as error:
        raise ArtifactError(f"{path}: {error}. Run offline-export again.") from error


def _check_hash(path: Path, expected: str, found: str, what: str) -> None:
    if found != expected:
        raise ArtifactError(
            f"{path}: expected the {what} of SHA-256 {expected:.16}…, found {found:.16}…: the two "
            f"files are not of one export, or one was altered. Run offline-export again."
        )


def _unreadable(path: Path, what: str, error: OSError) -> ArtifactError:
    return ArtifactError(
        f"{path}: expected {what} of a model bundle, found nothing readable ({error.strerror}). "
        f"Point `model` at a folder that offline-export wrote."
    )


def _read_fields(path: Path) -> dict[str, Any]:
    """The fields of `koopman.npz` as the texts, numbers, tuples and arrays that `FIELDS` lists."""
    try:
        arrays = read_arrays(path, LARGEST_FILE_BYTES, LARGEST_UNPACKED_BYTES)
    except OSError as error:
        raise _unreadable(path, "the matrices", error) from error
    except DamagedArchiveError as error:
        raise ArtifactError(
            f"{path}: expected an npz archive without pickles, found something else, or a "
            f"truncated or altered file ({error}). Run offline-export again."
        ) from error
    version = arrays["format_version"].tolist() if "format_version" in arrays else FORMAT_VERSION
    if version != FORMAT_VERSION:
        raise ArtifactError(
            f"{path}: expected format_version = {FORMAT_VERSION}, found {version!s:.40}. Run "
            f"offline-export RUN again with this version; for a newer bundle install a newer "
            f"rt-controller."
        )
    required = dict(FIELDS)
    for group in GROUPS:
        if not arrays.keys().isdisjoint(group):
            required |= group
    for key in ("format_version", *required):
        if key not in arrays:
            raise ArtifactError(
                f"{path}: expected a field {key!r}, found {sorted(arrays)}. "
                f"Run offline-export again."
            )
    present = required | {key: kind for key, kind in OPTIONAL.items() if key in arrays}
    return {key: _checked(path, key, arrays[key], *kind) for key, kind in present.items()}


def _checked(path: Path, key: str, found: NDArray[Any], kind: str, dimensions: int) -> Any:
    """The content of one field; numbers have eight bytes and are finite, arrays in C order."""
    is_wide = kind == "U" or found.dtype in (np.float64, np.int64)
    if found.dtype.kind != kind or found.ndim != dimensions or not is_wide:
        expected = {
            ("U", 0): "one text",
            ("U", 1): "a list of texts",
            ("i", 0): "one whole number",
            ("i", 1): "a list of whole numbers",
        }.get((kind, dimensions), f"float64 numbers in {dimensions} dimensions")
        raise ArtifactError(
            f"{path}: expected {expected} in {key}, found {found.dtype} of shape {found.shape}. "
            f"Run offline-export again."
        )
    if kind == "f" and not np.all(np.isfinite(found)):
        raise ArtifactError(
            f"{path}: expected finite numbers in {key}, found "
            f"{np.count_nonzero(~np.isfinite(found))} that are not. Run offline-export again."
        )
    if dimensions == 0:
        return found.item()
    return tuple(found.tolist()) if kind == "U" else np.asarray(found, order="C")
