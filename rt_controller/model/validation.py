"""Checks of a bundle: its parts fit each other, and the controller can drive with it."""

from dataclasses import asdict
from pathlib import Path
from typing import NoReturn

import numpy as np

from rt_controller.contract.car import car_of
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import PATH_STATES, VEHICLE
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Shape, no_gains
from rt_controller.model.follow import Follow
from rt_controller.model.path_kinematics import Movement
from rt_controller.model.validity import CONDITIONS

DRIVABLE_HISTORY = ("vx_mps", "vy_mps", "yaw_rate_radps", "throttle", "brake_n", "steer_rad")
"""the history that the controller keeps: motion and inputs of the car, not its place on the road"""


def refuse(path: Path | str, expected: object, found: object) -> NoReturn:
    """Refuse a bundle that is read or written at `path`."""
    raise ArtifactError(
        f"{path}: expected {expected}, found {found!s:.200}. Run offline-export again, of the "
        f"same version as this controller."
    )


def require_fitting_parts(bundle: Bundle, path: Path | str) -> None:
    """Return if signals, lift, gains and validity of a bundle, whose shapes fit, fit each other.

    Raises:
        ArtifactError: they do not; `path` names the file that is read or written.
    """
    schema, lift, n = bundle.schema, bundle.lift, bundle.n_observables
    known = schema.state_names + schema.input_names
    names = known + schema.exogenous_names
    if not schema.states or len(set(names)) < len(names) or not schema.dt_s > 0.0:
        expected = "at least one state, different names for all signals, and a positive dt_s"
        refuse(path, expected, f"{names} and {schema.dt_s}")
    if lift.history_fields != tuple(name for name in known if name in lift.history_fields):
        refuse(path, f"history_fields out of {known}, in this order", lift.history_fields)
    b, steps, _ = bundle.selftest.history.shape
    if lift.history_steps != steps:
        refuse(path, f"history_steps = {steps}", lift.history_steps)
    most_instants = 1000  # of a self-test, which is repeated at every start; export stores 32
    if n < len(schema.states) or not 1 <= b <= most_instants:
        states, found = len(schema.states), f"{n} and {b}"
        refuse(
            path,
            f"at least {states} observables and 1 to {most_instants} self-test instants",
            found,
        )
    if not (bundle.name.isprintable() and 0 < len(bundle.name) <= 100):
        refuse(path, "a name of 1 to 100 printable characters", f"{bundle.name!r:.60}")
    _require_fitting_gains(bundle, path)
    if bundle.movement is not None:
        _require_separate_path(bundle, bundle.movement, path)
    if bundle.validity is not None:
        speeds, conditions = bundle.validity.speed_mps, bundle.validity.conditions
        is_negative = any(np.any(each < 0.0) for each in bundle.validity[:4])
        if len(speeds) < 2 or np.any(np.diff(speeds) <= 0.0) or is_negative:
            refuse(
                path,
                "two or more ascending speeds in valid_speed_mps, and no negative value in valid_*",
                bundle.validity[:4],
            )
        count = len(CONDITIONS)
        if len(conditions) not in (0, count) or np.any(np.diff(conditions) < 0.0):
            expected = f"lowest and highest value of {count} quantities, or of none, in"
            refuse(path, f"{expected} valid_conditions", conditions)
    if bundle.car is not None:
        try:
            car_of(asdict(bundle.car))
        except ValueError as error:
            raise ArtifactError(f"{path}: {error}.") from error


def _require_fitting_gains(bundle: Bundle, path: Path | str) -> None:
    _, _, _, factor, shape, _ = bundle.gains or no_gains(bundle.n_observables)
    one = len(bundle.schema.inputs) + len(bundle.schema.exogenous)
    if not np.isin(factor, range(one + 1)).all():
        refuse(path, f"columns 0 to {one} of [u; w; 1] in gains_factor", factor)
    if not np.isin(shape, list(Shape)).all() or np.any(np.diff(shape) < 0):
        refuse(path, f"numbers 0 to {max(Shape)} in ascending order in gains_shape", shape)
    if np.any(factor[shape == Shape.SATURATION] != one):
        refuse(path, f"{one} in gains_factor where gains_shape is {Shape.SATURATION}", factor)


def _require_separate_path(bundle: Bundle, movement: Movement, path: Path | str) -> None:
    """Refuse path states that do not follow from the motion alone."""
    schema = bundle.schema
    if schema.states != VEHICLE.states or schema.exogenous[:1] != VEHICLE.exogenous:
        refuse(
            path,
            "the states of a car on a road of one curvature where the path follows from the motion",
            f"{schema.state_names} and {schema.exogenous_names}",
        )
    gains = bundle.gains or no_gains(bundle.n_observables)
    forcing = np.hstack([bundle.A, bundle.B_uc, bundle.B_uw, bundle.c[:, None], gains.N])
    reading = np.vstack([bundle.A, gains.S, movement.S])
    if forcing[PATH_STATES].any() or reading[:, PATH_STATES].any():
        expected = "zeros for the path states in A, B_uc, B_uw, c and the gains, where the path"
        refuse(path, f"{expected} follows from the motion", "others")


def require_drivable(bundle: Bundle) -> None:
    """Refuse a model with which the controller cannot drive the car."""
    objection = find_objection_to_driving(bundle)
    if objection is not None:
        raise ArtifactError(f"{objection} Choose another `model`.")


def find_objection_to_driving(bundle: Bundle) -> str | None:
    """The reason why the controller cannot drive the car with this model; None if it can."""
    found, expected, history = bundle.schema, VEHICLE, bundle.lift.history_fields
    follows = Follow.PREDICTION if bundle.gains is None else bundle.gains.follows
    for what, theirs, ours in (
        ("states", found.states, expected.states),
        ("inputs", found.inputs, expected.inputs),
        ("exogenous signals", found.exogenous, expected.exogenous),
        ("period in s", found.dt_s, expected.dt_s),
        ("history_fields", str(history), str(DRIVABLE_HISTORY if history else ())),
        ("gains_follows", follows, Follow.PREDICTION),
    ):
        if theirs != ours:
            return (
                f"The model {bundle.name!r} cannot drive this car: expected {what} = "
                f"{_plain(ours)}, found {_plain(theirs)}. It can be evaluated."
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
