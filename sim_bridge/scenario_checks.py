"""Checks of a scenario before its drive: against the plant, the friction and the steering wheel."""

from math import degrees

import numpy as np

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import (
    DEFAULT_GEOMETRY,
    PLAN_STEER_RAD,
    PLAN_TURN_MPS2,
    UNDERSTEER_RAD_PER_MPS2,
    SteeringGeometry,
)
from sim_bridge.plant.protocol import Plant, RoadTakingPlant
from sim_bridge.scenario import Scenario
from sim_bridge.scenario.checks import problems
from sim_bridge.scenario.limits import KMH_PER_MPS
from sim_bridge.scenario.nominal_drive import drive_nominally
from sim_bridge.scenario.table import constant

SHORT_S = 1.0
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


def grip_note(scenario: Scenario) -> str | None:
    """A sentence if the path cannot be driven with the friction of --friction; else None.

    With the friction in its file such a scenario is refused; --friction is there to try it.

    `scenario` has the friction that is driven.
    """
    found = problems(scenario)
    if not found:
        return None
    return f"scenario {scenario.name!r} with this --friction: {found[0]} It is driven all the same."


def steering_note(
    scenario: Scenario,
    geometry: SteeringGeometry = DEFAULT_GEOMETRY,
    most_plan_rad: float = PLAN_STEER_RAD,
) -> str | None:
    """A sentence if the reference needs more than the limit of the steering wheel; else None.

    Only what is needed for longer than `SHORT_S` counts: a car averages shorter peaks. The estimate
    is the steady state on the curvature of the wanted path: wheelbase times curvature
    plus understeer times lateral acceleration, times the steering ratio.

    Args:
        scenario: to be driven.
        geometry: of the car.
        most_plan_rad: largest angle that the model was trained with.
    """
    drive = drive_nominally(scenario)
    bend = np.gradient(np.gradient(drive.ey_m, drive.s_m), drive.s_m)
    turn = bend + scenario.road.curvature_per_m(drive.s_m)
    per_turn = geometry.wheelbase_m + UNDERSTEER_RAD_PER_MPS2 * drive.speed_mps**2
    wheel_rad = geometry.steering_ratio * np.abs(turn) * per_turn
    is_slow = drive.speed_mps < LOW_SPEED_MPS
    by_speed = [geometry.largest_wheel_rad(v, PLAN_TURN_MPS2) for v in drive.speed_mps.tolist()]
    limit_rad = np.where(is_slow, geometry.lock_rad, np.minimum(by_speed, most_plan_rad))
    edges = np.diff((wheel_rad > limit_rad).astype(int), prepend=0, append=0)
    firsts, lasts = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1
    long = [
        (first, last)
        for first, last in zip(firsts.tolist(), lasts.tolist(), strict=True)
        if drive.time_s[last] - drive.time_s[first] > SHORT_S
    ]
    if not long:
        return None
    worst = (first + int(np.argmax(wheel_rad[first : last + 1])) for first, last in long)
    i = max(worst, key=wheel_rad.__getitem__)
    above = "" if is_slow[i] else f" above {KMH_PER_MPS * LOW_SPEED_MPS:.0f} km/h"
    return (
        f"scenario {scenario.name!r}: a steady state needs about "
        f"{degrees(wheel_rad[i]):.0f} deg at the steering wheel at s = {drive.s_m[i]:.0f} m "
        f"(radius {1.0 / abs(turn[i]):.0f} m, "
        f"{KMH_PER_MPS * drive.speed_mps[i]:.0f} km/h); the controller is limited to "
        f"{degrees(limit_rad[i]):.0f} deg{above}, so the car cannot follow the path there"
    )
