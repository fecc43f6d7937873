"""Whether the parts of a bundle fit each other, and whether the car can be driven with it."""

from pathlib import Path

from rt_controller.contract.bundle import Bundle
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.koopman_file import check_field
from rt_controller.contract.schema import VEHICLE, Schema

DRIVABLE_HISTORY = ("vx_mps", "vy_mps", "yaw_rate_radps", "throttle", "brake_n", "steer_rad")
"""what the car's past is told by: its motion and its inputs, not where the road lay"""


def require_fitting_parts(bundle: Bundle, path: Path) -> None:
    """Return if signals, lift, matrices and self-test of a bundle are of one model.

    Raises:
        ArtifactError: they are not; `path` is the file that is read or written.
    """
    schema, lift, n = bundle.schema, bundle.lift, bundle.n_observables
    n_x, m, p = len(schema.states), len(schema.inputs), len(schema.exogenous)
    b = bundle.selftest.x.shape[0]
    _require_sound(schema, path)
    _require_known_history(bundle, path)

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
    if n < n_x or b < 1:
        raise ArtifactError(
            f"{path}: expected at least {n_x} observables and one self-test instant, found {n} "
            f"and {b}. Run offline-export again."
        )


def require_drivable(bundle: Bundle) -> None:
    """Return if the controller can drive the car with this model.

    Raises:
        ArtifactError: it is a model of other signals, of another period, or of a past that the
            controller does not keep.
    """
    objection = find_objection_to_driving(bundle)
    if objection is not None:
        raise ArtifactError(f"{objection} Choose another --model.")


def find_objection_to_driving(bundle: Bundle) -> str | None:
    """Why the controller cannot drive the car with this model, in words; None if it can."""
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
            f"The model {bundle.name!r} is shown a past that the controller does not keep: "
            f"expected history_fields = {DRIVABLE_HISTORY}, found {fields}. It can be evaluated, "
            f"but not driven with."
        )
    return None


def _plain(part: object) -> str:
    if isinstance(part, tuple):
        return ", ".join(f"{name} [{unit}]" for name, unit in part) or "none"
    return str(part)


def _require_sound(schema: Schema, path: Path) -> None:
    names = schema.state_names + schema.input_names + schema.exogenous_names
    if not schema.states or len(set(names)) < len(names) or not schema.dt_s > 0.0:
        raise ArtifactError(
            f"{path}: expected at least one state, a name for each signal alone, and a positive "
            f"dt_s, found {names} and {schema.dt_s}. Run offline-export again."
        )


def _require_known_history(bundle: Bundle, path: Path) -> None:
    fields = bundle.lift.history_fields
    known = bundle.schema.state_names + bundle.schema.input_names
    if fields != tuple(name for name in known if name in fields):
        raise ArtifactError(
            f"{path}: expected history_fields out of {known}, in this order, found {fields}. Run "
            f"offline-export again."
        )
