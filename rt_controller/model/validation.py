"""Checks of a bundle: its parts fit each other, and the controller can drive with it."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import LARGEST, SMALLEST, SteeringGeometry
from rt_controller.contract.signals import VEHICLE
from rt_controller.model.bundle import Bundle

DRIVABLE_HISTORY = ("vx_mps", "vy_mps", "yaw_rate_radps", "throttle", "brake_n", "steer_rad")
"""the history that the controller keeps: motion and inputs of the car, not its place on the road"""
LONGEST_NAME = 100
MOST_INSTANTS = 1000
"""of a self-test, which is repeated at every start; export stores 32"""


def require_fitting_parts(bundle: Bundle, path: Path | str) -> None:
    """Return if signals, lift, matrices and self-test of a bundle fit each other.

    Raises:
        ArtifactError: they do not; `path` names the file that is read or written.
    """
    schema, lift, n = bundle.schema, bundle.lift, bundle.n_observables
    n_x, m, p = len(schema.states), len(schema.inputs), len(schema.exogenous)
    b = bundle.selftest.x.shape[0]
    names = schema.state_names + schema.input_names + schema.exogenous_names
    if not schema.states or len(set(names)) < len(names) or not schema.dt_s > 0.0:
        raise ArtifactError(
            f"{path}: expected at least one state, different names for all signals, and a positive "
            f"dt_s, found {names} and {schema.dt_s}. Run offline-export again."
        )
    known = schema.state_names + schema.input_names
    if lift.history_fields != tuple(name for name in known if name in lift.history_fields):
        raise ArtifactError(
            f"{path}: expected history_fields out of {known}, in this order, found "
            f"{lift.history_fields}. Run offline-export again."
        )
    shapes: dict[str, tuple[NDArray[Any], tuple[int, ...]]] = {
        "A": (bundle.A, (n, n)),
        "B_uc": (bundle.B_uc, (n, m)),
        "B_uw": (bundle.B_uw, (n, p)),
        "c": (bundle.c, (n,)),
        "selftest_x": (bundle.selftest.x, (b, n_x)),
        "selftest_w": (bundle.selftest.w, (b, p)),
        "selftest_history": (
            bundle.selftest.history,
            (b, lift.history_steps, len(lift.history_fields)),
        ),
        "selftest_psi": (bundle.selftest_psi, (b, n)),
    }
    if bundle.bilinear is not None:
        R = bundle.bilinear.rank
        shapes["bilinear_N"] = (bundle.bilinear.N, (R, n, m))
        shapes["bilinear_S"] = (bundle.bilinear.S, (R, m, n))
        shapes["bilinear_s0"] = (bundle.bilinear.s0, (R, m))
    if bundle.drift is not None:
        D = bundle.drift.rank
        shapes["drift_N"] = (bundle.drift.N, (n, D))
        shapes["drift_S"] = (bundle.drift.S, (D, n))
        shapes["drift_s0"] = (bundle.drift.s0, (D,))
        shapes["drift_signal"] = (bundle.drift.signal, (D,))
    if bundle.signal_range is not None:
        shapes["signal_range"] = (bundle.signal_range, (2, m + p))
    if bundle.plans is not None:
        T, N = bundle.plans.inputs.shape[:2]
        plan_shapes = ((T, n_x), (T,), (T, 6), (T, m), (T, N, m))
        for name, array, shape in zip(bundle.plans._fields, bundle.plans, plan_shapes, strict=True):
            shapes[f"plan_{name}"] = (array, shape)
    for key, (array, shape) in shapes.items():
        check_field(path, f"shape of {key}", shape, array.shape)
    if bundle.geometry is not None and find_objection_to_geometry(bundle.geometry):
        raise ArtifactError(f"{path}: {find_objection_to_geometry(bundle.geometry)}")
    if bundle.drift is not None and not set(bundle.drift.signal.tolist()) <= set(range(-1, p)):
        raise ArtifactError(
            f"{path}: expected drift_signal from -1 to {p - 1}, found "
            f"{bundle.drift.signal.tolist()!s:.200}. Run offline-export again."
        )
    if n < n_x or not 1 <= b <= MOST_INSTANTS:
        raise ArtifactError(
            f"{path}: expected at least {n_x} observables and 1 to {MOST_INSTANTS} self-test "
            f"instants, found {n} and {b}. Run offline-export again."
        )
    if not bundle.name.isprintable() or not 0 < len(bundle.name) <= LONGEST_NAME:
        raise ArtifactError(
            f"{path}: expected a name of 1 to {LONGEST_NAME} printable characters, found "
            f"{bundle.name!r:.60}. Run offline-export again."
        )


def require_matrix(name: str, matrix: Array, shape: tuple[int, ...]) -> None:
    """Return if a matrix has this shape and finite real numbers.

    Raises:
        ArtifactError: it has not.
    """
    array = np.asarray(matrix)
    if array.shape != shape:
        raise ArtifactError(f"{name}: expected the shape {shape}, found {array.shape}.")
    if not (np.isrealobj(array) and np.isfinite(array.astype(np.float64)).all()):
        raise ArtifactError(f"{name}: expected finite real numbers, found others.")


def find_objection_to_geometry(geometry: SteeringGeometry) -> str | None:
    """The numbers of the car that are no road vehicle's; None if there are none."""
    wrong = [
        f"{name}: expected {low:g} to {high:g}, found {value:g}"
        for name, value, low, high in zip(
            SteeringGeometry._fields, geometry, SMALLEST, LARGEST, strict=True
        )
        if not low <= value <= high
    ]
    return "; ".join(wrong) + "." if wrong else None


def require_drivable(bundle: Bundle) -> None:
    """Return if the controller can drive the car with this model.

    Raises:
        ArtifactError: it has other signals, another period, or a history that the controller does
            not keep.
    """
    objection = find_objection_to_driving(bundle)
    if objection is not None:
        raise ArtifactError(f"{objection} Choose another `model`.")


def find_objection_to_driving(bundle: Bundle) -> str | None:
    """The reason why the controller cannot drive the car with this model; None if it can."""
    found, expected = bundle.schema, VEHICLE
    for what, theirs, ours in (
        ("states", found.states, expected.states),
        ("inputs", found.inputs, expected.inputs),
        ("exogenous signals", found.exogenous, expected.exogenous),
        ("period in s", found.dt_s, expected.dt_s),
    ):
        if theirs != ours:
            return (
                f"The model {bundle.name!r} is not a model of this car: expected {what} = "
                f"{_plain(ours)}, found {_plain(theirs)}. It can be evaluated, but not driven with."
            )
    fields = bundle.lift.history_fields
    if bundle.lift.sees_history and fields != DRIVABLE_HISTORY:
        return (
            f"The model {bundle.name!r} needs a history that the controller does not keep: "
            f"expected history_fields = {DRIVABLE_HISTORY}, found {fields}. It can be evaluated, "
            f"but not driven with."
        )
    return None


def explain_missing_plans(bundle: Bundle, folder: Path) -> str:
    """The message about a model of this car without stored plans; empty if it has some."""
    if bundle.plans is not None or find_objection_to_driving(bundle) is not None:
        return ""
    return (
        f"{folder}: expected a model with stored plans, found one without, so that a change after "
        f"its export cannot be detected. Store plans, without training: offline-export --bundle "
        f"{folder}"
    )


def _plain(part: object) -> str:
    if isinstance(part, tuple):
        return ", ".join(f"{name} [{unit}]" for name, unit in part) or "none"
    return str(part)


def check_field(path: Path | str, key: str, expected: object, found: object) -> None:
    """Return if both are equal.

    Raises:
        ArtifactError: they are not.
    """
    if expected != found:
        raise ArtifactError(
            f"{path}: expected {key} = {expected}, found {found!s:.200}. This bundle was made for "
            f"another controller: run offline-export of the same version."
        )
