"""Scenarios with other roads, cars, wind and requests, and noise of sensors."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import count
from math import radians
from typing import NamedTuple

import numpy as np

from sim_bridge.faults.sensors import offset, sensor_noise
from sim_bridge.plant.shipped_cars import shipped_cars
from sim_bridge.scenario import Scenario, load_scenario
from sim_bridge.scenario.checks import problems
from sim_bridge.scenario.scenario import Load
from sim_bridge.scenario.speed import constant_speed
from sim_bridge.scenario.table import constant

FRICTION = (0.5, 1.0)
MASS_KG = (-225.0, 225.0)
"""15 % of the car"""
GRADE, BANK_DEG, WIND_MPS = 0.2, 6.0, 20.0
CLIMBED_GRADE, SPLIT_FRICTION = 0.15, 0.375
"""on a grade above 0.15 times the friction two driven wheels spin; mean of both sides"""
SPEED_STEP_MPS, PATH_STEP_M = 5.0, 0.5
"""requests at any time"""
WITHOUT_NOISE, WITH_REQUEST, ON_FLAT_ROAD = 0.25, 0.5, 0.25
"""parts of the drives"""
EARLIEST_STOP_S = 1.0
_CORNERS = tuple((friction, mass_kg) for friction in FRICTION for mass_kg in MASS_KG)


class Condition(NamedTuple):
    """One drive."""

    scenario: str
    friction: float
    mass_kg: float
    """beside that of the car"""
    seed: int
    stop_at_s: float | None
    """the controller is asked to end the drive after this time; None: at the end of the scenario"""
    car: str
    grade: float
    bank_deg: float
    wind_mps: float
    """from the right"""
    speed_step_mps: float
    """of the wanted speed, where it is constant"""
    path_step_m: float
    request_at_s: float
    has_noise: bool


def conditions(scenarios: Sequence[str]) -> Iterator[Condition]:
    """All scenarios with the first seed, then with the next, without an end.

    The first four seeds have the extremes of friction and mass, later ones what is drawn between.
    Odd seeds end in a stop that is requested at any time of the scenario.
    """
    loaded = {name: load_scenario(name) for name in scenarios}
    cars = shipped_cars()
    for seed in count():
        for index, (name, scenario) in enumerate(loaded.items()):
            rng = np.random.default_rng((seed, index))
            friction, mass_kg = _drawn(rng, *FRICTION), _drawn(rng, *MASS_KG)
            stop_at_s = _drawn(rng, EARLIEST_STOP_S, scenario.duration_s)
            if seed < len(_CORNERS):
                friction, mass_kg = _CORNERS[seed]
            steepest = GRADE
            if _is_split(scenario):
                steepest = CLIMBED_GRADE * SPLIT_FRICTION
            elif scenario.start.speed_mps == 0.0:
                steepest = CLIMBED_GRADE * friction
            slope, has_request = rng.random() >= ON_FLAT_ROAD, rng.random() < WITH_REQUEST
            has_speed_request = has_request and scenario.speed.is_constant
            condition = Condition(
                *(name, friction, mass_kg, seed, stop_at_s if seed % 2 == 1 else None),
                car=cars[int(rng.integers(len(cars)))],
                grade=_drawn(rng, -steepest, steepest) * slope,
                bank_deg=_drawn(rng, -BANK_DEG, BANK_DEG) * slope,
                wind_mps=_drawn(rng, -WIND_MPS, WIND_MPS) * slope,
                speed_step_mps=_drawn(rng, -SPEED_STEP_MPS, SPEED_STEP_MPS) * has_speed_request,
                path_step_m=_drawn(rng, -PATH_STEP_M, PATH_STEP_M) * has_request,
                request_at_s=_drawn(rng, EARLIEST_STOP_S, 0.8 * scenario.duration_s),
                has_noise=rng.random() >= WITHOUT_NOISE,
            )
            driven = disturbed(condition)
            if problems(driven):  # too little grip for the slope or the bank
                condition = condition._replace(grade=0.0, bank_deg=0.0)
                driven = disturbed(condition)
            if condition.speed_step_mps:
                speed_mps = driven.speed.highest_mps + condition.speed_step_mps
                start = driven.start.model_copy(update={"speed_mps": speed_mps})
                wanted = {"speed_kmh": constant_speed(speed_mps)}
                reference = driven.reference.model_copy(update=wanted)
                faster = replace(driven, reference=reference, initial=start)
                if problems(faster):  # the path is too sharp for it
                    condition = condition._replace(speed_step_mps=0.0)
            yield condition


def _drawn(rng: np.random.Generator, least: float, most: float) -> float:
    return round(float(rng.uniform(least, most)), 3)


def disturbed(condition: Condition) -> Scenario:
    """The scenario of a condition, with its road, wind and requests, and noise on all states."""
    rng = np.random.default_rng((condition.seed, len(condition.scenario)))
    scenario = load_scenario(condition.scenario)
    faults = sensor_noise(rng) if condition.has_noise else []
    requests = (("v_mps", condition.speed_step_mps), ("c0_m", condition.path_step_m))
    faults += [offset(name, by, condition.request_at_s) for name, by in requests if by]
    slope = {"grade": condition.grade, "bank_rad": radians(condition.bank_deg)}
    changed = replace(
        scenario,
        payload=Load.model_construct(mass_kg=condition.mass_kg),
        faults=tuple(faults),
        cross_wind_mps=constant(condition.wind_mps),
        road=scenario.road.model_copy(update={name: constant(x) for name, x in slope.items()}),
    )
    return changed if _is_split(scenario) else changed.with_friction(condition.friction)


def _is_split(scenario: Scenario) -> bool:
    """True if the friction is part of the scenario."""
    return scenario.name.startswith("braking on split")
