"""Checks of a bundle: its parts fit each other, and the controller can drive with it."""

from pathlib import Path

from rt_controller.contract.bundle import Bundle
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.schema import VEHICLE
from rt_controller.contract.steering_geometry import LARGEST, SMALLEST, SteeringGeometry

DRIVABLE_HISTORY = ("vx_mps", "vy_mps", "yaw_rate_radps", "throttle", "brake_n", "steer_rad")
"""the history that the controller keeps: motion and inputs of the car, not its place on the road"""


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
    shapes = {
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
    for key, (array, shape) in shapes.items():
        check_field(path, f"shape of {key}", shape, array.shape)
    if bundle.geometry is not None and find_objection_to_geometry(bundle.geometry):
        raise ArtifactError(f"{path}: {find_objection_to_geometry(bundle.geometry)}")
    if n < n_x or b < 1:
        raise ArtifactError(
            f"{path}: expected at least {n_x} observables and one self-test instant, found {n} "
            f"and {b}. Run offline-export again."
        )


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
