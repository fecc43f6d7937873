"""Checks of a bundle: its parts fit each other, and the controller can drive with it."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from rt_controller.contract.car import car_of
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import PATH_STATES, VEHICLE
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Shape, no_gains
from rt_controller.model.follow import Follow
from rt_controller.model.validity import CONDITIONS

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
    known = schema.state_names + schema.input_names
    names = known + schema.exogenous_names

    def refuse_unless(is_right: object, expected: str, found: object) -> None:
        if not is_right:
            raise ArtifactError(
                f"{path}: expected {expected}, found {found!s:.200}. Run offline-export again."
            )

    refuse_unless(
        schema.states and len(set(names)) == len(names) and schema.dt_s > 0.0,
        "at least one state, different names for all signals, and a positive dt_s",
        f"{names} and {schema.dt_s}",
    )
    refuse_unless(
        lift.history_fields == tuple(name for name in known if name in lift.history_fields),
        f"history_fields out of {known}, in this order",
        lift.history_fields,
    )
    wanted: list[tuple[str, Any, tuple[int, ...]]] = [
        ("A", bundle.A, (n, n)),
        ("B_uc", bundle.B_uc, (n, m)),
        ("B_uw", bundle.B_uw, (n, p)),
        ("c", bundle.c, (n,)),
        ("selftest_psi", bundle.selftest_psi, (b, n)),
        ("signal_range", bundle.signal_range, (2, m + p)),
    ]
    gains = bundle.gains or no_gains(n)
    q = len(gains.s0)
    validity = bundle.validity
    knots, known_conditions = (validity.speed_mps, validity.conditions) if validity else ((), ())
    k = len(knots)
    T, N = bundle.plans.inputs.shape[:2] if bundle.plans else (0, 0)
    parts: tuple[tuple[str, Any, tuple[tuple[Any, ...], ...]], ...] = (
        (
            "selftest",
            bundle.selftest,
            ((b, n_x), (b, p), (b, lift.history_steps, len(lift.history_fields))),
        ),
        ("gains", gains, ((n, q), (q, n), (q,), (q,), (q,))),
        ("plan", bundle.plans, ((T, n_x), (T,), (T, 6), (T, m), (T, N, m))),
        ("movement", bundle.movement, ((3, n), (3,))),
        ("valid", validity, ((k,), (k,), (k,), (k,), (len(known_conditions), 2))),
    )
    for kind, part, shapes in parts:
        if part is not None:
            fields = zip(part._fields, part, shapes, strict=False)
            wanted += [(f"{kind}_{name}", array, shape) for name, array, shape in fields]
    for key, array, shape in wanted:
        if array is not None:
            check_field(path, f"shape of {key}", shape, array.shape)
    refuse_unless(
        np.isin(gains.factor, range(m + p + 1)).all(),
        f"columns 0 to {m + p} of [u; w; 1] in gains_factor",
        gains.factor,
    )
    refuse_unless(
        np.isin(gains.shape, list(Shape)).all() and np.all(np.diff(gains.shape) >= 0),
        f"numbers 0 to {max(Shape)} in ascending order in gains_shape",
        gains.shape,
    )
    refuse_unless(
        np.all(gains.factor[gains.shape == Shape.SATURATION] == m + p),
        f"{m + p} in gains_factor where gains_shape is {Shape.SATURATION}",
        gains.factor,
    )
    if bundle.movement is not None:
        columns = [*range(n)[PATH_STATES]]
        refuse_unless(
            schema.states == VEHICLE.states and schema.exogenous[:1] == VEHICLE.exogenous,
            "the states of a car on a road of one curvature where the path follows from the motion",
            f"{schema.state_names} and {schema.exogenous_names}",
        )
        forcing = np.hstack([bundle.B_uc, bundle.B_uw, bundle.c[:, None], gains.N])
        reads_path = np.vstack([bundle.A, gains.S, bundle.movement.S])[:, columns]
        refuse_unless(
            not (bundle.A[columns].any() or forcing[columns].any() or reads_path.any()),
            "zeros for the path states in A, B_uc, B_uw, c and the gains, where the path follows "
            "from the motion",
            "others",
        )
    if validity is not None:
        refuse_unless(
            k > 1
            and np.all(np.diff(knots) > 0.0)
            and all(np.all(each >= 0.0) for each in validity[:4]),
            "two or more ascending speeds in valid_speed_mps, and no negative value in valid_*",
            validity[:4],
        )
        refuse_unless(
            len(known_conditions) in (0, len(CONDITIONS))
            and np.all(np.diff(known_conditions) >= 0.0),
            f"lowest and highest value of {len(CONDITIONS)} quantities, or of none, in "
            f"valid_conditions",
            known_conditions,
        )
    refuse_unless(
        n >= n_x and 1 <= b <= MOST_INSTANTS,
        f"at least {n_x} observables and 1 to {MOST_INSTANTS} self-test instants",
        f"{n} and {b}",
    )
    refuse_unless(
        bundle.name.isprintable() and 0 < len(bundle.name) <= LONGEST_NAME,
        f"a name of 1 to {LONGEST_NAME} printable characters",
        f"{bundle.name!r:.60}",
    )
    if bundle.car is not None:
        try:
            car_of(asdict(bundle.car))
        except ValueError as error:
            raise ArtifactError(f"{path}: {error}.") from error


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


def check_field(path: Path | str, key: str, expected: object, found: object) -> None:
    """Refuse a field of a bundle that is not as expected."""
    if expected != found:
        raise ArtifactError(
            f"{path}: expected {key} = {expected}, found {found!s:.200}. This bundle was made for "
            f"another controller: run offline-export of the same version."
        )
