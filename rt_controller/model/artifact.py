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
from collections.abc import Mapping
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
from rt_controller.model.validation import refuse, require_fitting_parts
from rt_controller.model.validity import Validity

SHIPPED_MODEL = "mdk-net"
"""the model that drives if none is chosen"""

FORMAT_VERSION = 5
LARGEST_FILE_BYTES = 64_000_000
ENCODER_FILE = "encoder.onnx"
KOOPMAN_FILE = "koopman.npz"
CARD_FILE = "card.md"

FIELDS = {
    name: (kind, shape.split())
    for kind, shape, names in (
        ("text", "", "name training data_sha256 encoder_sha256 bundle_sha256 gains_follows car"),
        ("text", "x", "state_fields state_units"),
        ("text", "m", "input_fields input_units"),
        ("text", "p", "exogenous_fields exogenous_units"),
        ("text", "i", "lift_inputs"),
        ("text", "h", "history_fields"),
        ("int64", "", "history_steps"),
        ("float64", "", "dt_s wheelbase_m rear_axle_m steering_ratio lock_rad"),
        ("float64", "n n", "A"),
        ("float64", "n m", "B_uc"),
        ("float64", "n p", "B_uw"),
        ("float64", "n", "c"),
        ("float64", "2 m+p", "signal_range"),
        ("float64", "q", "gains_s0"),
        ("float64", "n q", "gains_N"),
        ("float64", "q n", "gains_S"),
        ("int64", "q", "gains_factor gains_shape"),
        ("float64", "b x", "selftest_x"),
        ("float64", "b p", "selftest_w"),
        ("float64", "b H h", "selftest_history"),
        ("float64", "b n", "selftest_psi"),
        ("float64", "T N m", "plan_inputs"),
        ("float64", "T x", "plan_state"),
        ("float64", "T", "plan_curvature_per_m"),
        ("float64", "T 6", "plan_path"),
        ("float64", "T m", "plan_previous"),
        ("float64", "3 n", "movement_S"),
        ("float64", "3", "movement_s0"),
        ("float64", "k", "valid_speed_mps valid_lateral_mps2"),
        ("float64", "k", "valid_steer_rad valid_curvature_per_m"),
        ("float64", "d 2", "valid_conditions"),
    )
    for name in names.split()
}
"""type and shape of each field; a letter has one size in all, that of the first field with it"""
_PARTS: Mapping[str, tuple[str, Any]] = {
    "gains": ("gains", Gains),
    "selftest": ("selftest", LiftSample),
    "plan": ("plans", PlanSample),
    "movement": ("movement", Movement),
    "valid": ("validity", Validity),
}
"""by the beginning of their fields: attribute of `Bundle`, and its type with the other names"""
_UNCHANGED = ("name", "A", "B_uc", "B_uw", "c", "selftest_psi", "training", "data_sha256")
"""fields that are attributes of `Bundle` of the same name"""
_SIGNALS = {"state": "states", "input": "inputs", "exogenous": "exogenous"}
"""beginning of the fields that describe signals, and the attribute of `Schema`"""


def shipped_model(name: str = SHIPPED_MODEL) -> Path:
    """The folder of a bundle that ships with the package, as of `config.ShippedModel`."""
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
    path, fields = folder / KOOPMAN_FILE, _fields_of(bundle)
    _require_shapes(path, fields)
    require_fitting_parts(bundle, path)
    fields |= {
        "format_version": FORMAT_VERSION,
        "spectral_radius": bundle.spectral_radius,
        "growth_20": bundle.growth(20),
        "growth_80": bundle.growth(80),
        "encoder_sha256": bundle.encoder_sha256,
        "bundle_sha256": bundle.sha256,
    }
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_write(folder / ENCODER_FILE) as file:
        file.write(bundle.encoder_onnx)
    with atomic_write(path) as file:
        np.savez_compressed(file, **fields)
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
    bundle = _bundle_of(path, found, encoder)
    require_fitting_parts(bundle, path)
    _check_hash(encoder_path, found["encoder_sha256"], bundle.encoder_sha256, "encoder")
    _check_hash(path, found["bundle_sha256"], bundle.sha256, "model")
    return bundle


def _fields_of(bundle: Bundle) -> dict[str, Any]:
    """The arrays of `koopman.npz` by name, without the hashes."""
    schema, lift, car = bundle.schema, bundle.lift, bundle.car
    values = {
        **{name: getattr(bundle, name) for name in _UNCHANGED},
        "dt_s": schema.dt_s,
        "lift_inputs": lift.inputs,
        "history_steps": lift.history_steps,
        "history_fields": lift.history_fields,
    }
    for kind, attribute in _SIGNALS.items():
        signals = getattr(schema, attribute)
        values[f"{kind}_fields"] = [signal.name for signal in signals]
        values[f"{kind}_units"] = [signal.unit for signal in signals]
    parts = {prefix: getattr(bundle, attribute) for prefix, (attribute, _) in _PARTS.items()}
    parts["gains"] = bundle.gains or no_gains(bundle.n_observables)
    for prefix, part in parts.items():
        if part is not None:
            values |= {f"{prefix}_{name}": value for name, value in part._asdict().items()}
    if car is not None:
        values |= {**car.geometry._asdict(), "car": json.dumps(car.own_values)}
    if bundle.signal_range is not None:
        values["signal_range"] = bundle.signal_range
    return {
        name: np.asarray(value, dtype=np.str_ if FIELDS[name][0] == "text" else None)
        for name, value in values.items()
    }


def _bundle_of(path: Path, found: dict[str, Any], encoder_onnx: bytes) -> Bundle:
    """The bundle of the contents of the fields; the inverse of `_fields_of`."""
    lift = Lift("w" in found["lift_inputs"], found["history_steps"], found["history_fields"])
    if lift.inputs != found["lift_inputs"]:
        refuse(path, f"lift_inputs = {lift.inputs}", found["lift_inputs"])
    states, inputs, exogenous = (
        tuple(map(Signal, found[f"{kind}_fields"], found[f"{kind}_units"])) for kind in _SIGNALS
    )
    if found["gains_follows"] not in list(Follow):
        refuse(path, f"gains_follows = {' or '.join(Follow)}", found["gains_follows"])
    found["gains_follows"] = Follow(found["gains_follows"])
    parts = {
        attribute: kind(*(found[f"{prefix}_{name}"] for name in kind._fields))
        for prefix, (attribute, kind) in _PARTS.items()
        if f"{prefix}_{kind._fields[0]}" in found
    }
    if not found["gains_s0"].size:
        del parts["gains"]
    return Bundle(
        schema=Schema(states, inputs, exogenous, found["dt_s"]),
        lift=lift,
        car=_car(path, found),
        signal_range=found.get("signal_range"),
        encoder_onnx=encoder_onnx,
        **parts,
        **{name: found[name] for name in _UNCHANGED},
    )


def _content(field: NDArray[Any]) -> Any:
    """A text, a number, a tuple of texts, or an array in C order."""
    if field.ndim == 0:
        return field.item()
    return tuple(field.tolist()) if field.dtype.kind == "U" else np.asarray(field, order="C")


def _car(path: Path, found: Mapping[str, Any]) -> Car | None:
    geometry = {name: found[name] for name in SteeringGeometry._fields if name in found}
    if not geometry:
        return None
    try:
        return car_of({**geometry, **json.loads(found.get("car", "{}"))})
    except (ValueError, TypeError) as error:
        raise ArtifactError(f"{path}: {error}. Run offline-export again.") from error


def _check_hash(path: Path, expected: str, found: str, what: str) -> None:
    if found != expected:
        reason = "the two files are not of one export, or one was altered"
        refuse(path, f"the {what} of SHA-256 {expected:.16}…", f"{found:.16}…: {reason}")


def _unreadable(path: Path, what: str, error: OSError) -> ArtifactError:
    return ArtifactError(
        f"{path}: expected {what} of a model bundle, found nothing readable ({error.strerror}). "
        f"Point `model` at a folder that offline-export wrote."
    )


def _read_fields(path: Path) -> dict[str, Any]:
    """The contents of the fields of `koopman.npz`: texts, numbers, tuples of texts, and arrays."""
    most_unpacked_bytes = 4 * LARGEST_FILE_BYTES  # a hundred times the shipped models
    try:
        arrays = read_arrays(path, LARGEST_FILE_BYTES, most_unpacked_bytes)
    except OSError as error:
        raise _unreadable(path, "the matrices", error) from error
    except DamagedArchiveError as error:
        found = f"something else, or a truncated or altered file ({error})"
        refuse(path, "an npz archive without pickles", found)
    version = arrays["format_version"].tolist() if "format_version" in arrays else FORMAT_VERSION
    if version != FORMAT_VERSION:
        raise ArtifactError(
            f"{path}: expected format_version = {FORMAT_VERSION}, found {version!s:.40}. Run "
            f"offline-export RUN again with this version; for a newer bundle install a newer "
            f"rt-controller."
        )
    optional = {"car", "lock_rad", "signal_range"}
    parts = [{n for n in FIELDS if n.startswith(begin)} for begin in ("plan", "movement", "valid")]
    for part in ({*SteeringGeometry._fields}, *parts):
        if part.isdisjoint(arrays):  # has all of its fields or none
            optional |= part
    for key in ("format_version", *FIELDS):
        if key not in arrays and key not in optional:
            refuse(path, f"a field {key!r}", sorted(arrays))
    _require_shapes(path, arrays)
    return {key: _content(arrays[key]) for key in FIELDS if key in arrays}


def _require_shapes(path: Path, fields: Mapping[str, NDArray[Any]]) -> None:
    """Return if type and shape of each field are those of `FIELDS`, and its numbers finite."""
    sizes = {"2": 2, "3": 3, "6": 6}
    for key, (kind, shape) in FIELDS.items():
        if key not in fields:
            continue
        found, is_text = fields[key], kind == "text"
        is_right = found.dtype.kind == "U" if is_text else found.dtype == kind
        if not is_right or found.ndim != len(shape):
            expected = f"{kind} in {len(shape)} dimensions in {key}"
            refuse(path, expected, f"{found.dtype} of shape {found.shape}")
        if not is_text and not np.isfinite(found).all():
            count = np.count_nonzero(~np.isfinite(found))
            refuse(path, f"finite numbers in {key}", f"{count} that are not")
        fitting = tuple(
            sum(sizes.setdefault(letter, size) for letter in letters.split("+"))
            for letters, size in zip(shape, found.shape, strict=True)
        )
        if found.shape != fitting:
            refuse(path, f"shape of {key} = {fitting}", found.shape)
