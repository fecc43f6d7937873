"""Checks of a scenario before its drive: against the plant, the friction and the steering wheel."""

from collections.abc import Iterator
from math import degrees

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.car import DEFAULT_CAR
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import (
    DEFAULT_GEOMETRY,
    PLAN_STEER_RAD,
    UNDERSTEER_RAD_PER_MPS2,
    SteeringGeometry,
)
from rt_controller.model.bundle import Bundle
from rt_controller.model.validity import CONDITIONS
from sim_bridge.plant.protocol import Plant, RoadTakingPlant
from sim_bridge.scenario import Scenario
from sim_bridge.scenario.checks import problems
from sim_bridge.scenario.limits import KMH_PER_MPS
from sim_bridge.scenario.nominal_drive import NominalDrive, drive_nominally
from sim_bridge.scenario.table import constant

SHORT_S, SHORT_EXCESS_S = 1.0, 0.2
LOW_SPEED_MPS = 8.0
"""below it the low-speed law of the controller drives with the whole lock, by default"""


def require_road(plant: Plant, scenario: Scenario) -> None:
    """Return if the plant takes everything that the road of the scenario varies.

    Raises:
        ConfigError: it does not.
    """
    takes = plant.road_inputs if isinstance(plant, RoadTakingPlant) else frozenset[str]()
    road, still = scenario.road, constant(0.0)
    is_uniform = road.uniform_friction is not None
    missing = [
        name
        for field, name, table in (
            ("friction_left", "road.friction", still if is_uniform else road.friction_left),
            ("friction_right", "road.friction_right", still if is_uniform else road.friction_right),
            ("bank_rad", "road.bank_deg", road.bank_rad),
            ("grade_rad", "road.grade_percent", road.grade),
            ("wind_forward_mps", "tail_wind_mps", scenario.tail_wind_mps),
            ("wind_left_mps", "cross_wind_mps", scenario.cross_wind_mps),
        )
        if field not in takes and np.any(table.coefficients)
    ]
    if missing:
        raise ConfigError(
            f"scenario {scenario.name!r}: expected a plant that takes {', '.join(missing)}, found "
            f"{plant.name}, which does not. Leave {'it' if len(missing) == 1 else 'them'} out of "
            f"the scenario (friction: one number; a map: opendrive with flat = true), or choose "
            f"another --plant."
        )


def notes(
    scenario: Scenario,
    has_own_friction: bool,
    model: Bundle | None = None,
    geometry: SteeringGeometry = DEFAULT_GEOMETRY,
    most_plan_rad: float = PLAN_STEER_RAD,
) -> Iterator[str]:
    """Sentences about a scenario that can be driven, but not as it is wanted.

    With the friction in its file a path beyond the grip is refused; --friction is there to try it.

    Args:
        scenario: to be driven, with its friction.
        has_own_friction: the friction is one of --friction.
        model: of the controller; None: unknown.
        geometry: of the car.
        most_plan_rad: largest angle that the model was trained with.
    """
    drive = drive_nominally(scenario)
    yield from _steering_note(scenario, drive, geometry, most_plan_rad)
    if has_own_friction:
        for found in problems(scenario)[:1]:
            yield (
                f"scenario {scenario.name!r} with this --friction: {found} It is driven all the "
                f"same."
            )
    if model is not None:
        yield from _training_note(scenario, drive, model)


def _training_note(scenario: Scenario, drive: NominalDrive, model: Bundle) -> Iterator[str]:
    """A sentence if the scenario leaves the ranges of the training data of a model.

    Motion is that of a steady turn along the wanted path, above `LOW_SPEED_MPS`, where the model
    drives; what lasts less than `SHORT_EXCESS_S` is averaged by a car and does not count.
    """
    validity, trained = model.validity, model.trained_range
    if validity is None or trained is None:
        return
    wheel_rad = _steady_wheel_rad(drive, model.geometry or DEFAULT_GEOMETRY)
    lateral = drive.turn_per_m * drive.speed_mps**2
    road = scenario.road.curvature_per_m(drive.s_m)
    times = np.arange(drive.time_s[0], drive.time_s[-1], 0.5 * SHORT_EXCESS_S)
    at = np.minimum(np.searchsorted(drive.time_s, times), len(drive.s_m) - 1)
    motion = np.column_stack([drive.speed_mps, lateral, wheel_rad, road])[at].tolist()
    found = [trained.excess(*row) if row[0] >= LOW_SPEED_MPS else None for row in motion]
    lasting = [
        (excess, row[0])
        for before, excess, row in zip([None, *found], found, motion, strict=False)
        if excess is not None and before is not None
    ]
    parts = [worst.named(speed_mps) for worst, speed_mps in sorted(lasting)[-1:]]
    ground = scenario.road
    values = (
        np.concatenate([ground.friction_left(drive.s_m), ground.friction_right(drive.s_m)]),
        ground.grade(drive.s_m),
        ground.bank_rad(drive.s_m),
        np.array([scenario.payload.mass_kg]),
    )
    for shown, limits, driven in zip(CONDITIONS, validity.conditions, values, strict=False):
        outside = np.maximum(limits[0] - driven, driven - limits[1])
        if outside.max() > shown.tolerance:
            worst_value = driven[outside.argmax()]
            parts.append(f"{shown.text(worst_value)} (trained {shown.span(limits)})")
    if parts:
        yield (
            f"scenario {scenario.name!r} leaves what the model was trained with: {'; '.join(parts)}"
        )


def _steady_wheel_rad(drive: NominalDrive, geometry: SteeringGeometry) -> Array:
    """Magnitude of the steering wheel in a steady turn on the wanted path."""
    per_turn = geometry.wheelbase_m + UNDERSTEER_RAD_PER_MPS2 * drive.speed_mps**2
    return geometry.steering_ratio * np.abs(drive.turn_per_m) * per_turn


def _steering_note(
    scenario: Scenario, drive: NominalDrive, geometry: SteeringGeometry, most_plan_rad: float
) -> Iterator[str]:
    """A sentence if the reference needs more than the limit of the steering wheel.

    Only what is needed for longer than `SHORT_S` counts: a car averages shorter peaks. The estimate
    is the steady state on the curvature of the wanted path: wheelbase times curvature
    plus understeer times lateral acceleration, times the steering ratio.
    """
    wheel_rad = _steady_wheel_rad(drive, geometry)
    is_slow = drive.speed_mps < LOW_SPEED_MPS
    lateral_mps2 = DEFAULT_CAR.plan_lateral_mps2
    by_speed = [geometry.largest_wheel_rad(v, lateral_mps2) for v in drive.speed_mps.tolist()]
    limit_rad = np.where(is_slow, geometry.lock_rad, np.minimum(by_speed, most_plan_rad))
    edges = np.diff((wheel_rad > limit_rad).astype(int), prepend=0, append=0)
    firsts, lasts = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1
    long = [
        (first, last)
        for first, last in zip(firsts.tolist(), lasts.tolist(), strict=True)
        if drive.time_s[last] - drive.time_s[first] > SHORT_S
    ]
    if not long:
        return
    worst = (first + int(np.argmax(wheel_rad[first : last + 1])) for first, last in long)
    i = max(worst, key=wheel_rad.__getitem__)
    above = "" if is_slow[i] else f" above {KMH_PER_MPS * LOW_SPEED_MPS:.0f} km/h"
    yield (
        f"scenario {scenario.name!r}: a steady state needs about "
        f"{degrees(wheel_rad[i]):.0f} deg at the steering wheel at s = {drive.s_m[i]:.0f} m "
        f"(radius {1.0 / abs(drive.turn_per_m[i]):.0f} m, "
        f"{KMH_PER_MPS * drive.speed_mps[i]:.0f} km/h); the controller is limited to "
        f"{degrees(limit_rad[i]):.0f} deg{above}, so the car cannot follow the path there"
    )
