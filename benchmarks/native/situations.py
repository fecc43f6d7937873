"""Random situations of a car, as calls of a planner."""

from collections.abc import Iterator
from math import inf
from typing import Any

import numpy as np

from benchmarks.native.recorded import Call
from rt_controller.contract.arrays import Array
from rt_controller.contract.car import UNNAMED_CAR
from rt_controller.contract.signals import (
    ControlInput,
    CurvaturePreview,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.model.bundle import Bundle
from rt_controller.model.validity import Validity

PLANS = 2
"""of each situation: a first one, and one that was prepared"""
_ANY_CAR = Validity(
    np.array([8.0, 30.0]),
    np.array([5.0, 5.0]),
    np.array([1.0, 0.5]),
    np.array([0.03, 0.008]),
    np.zeros((0, 2)),
)
"""for a model that does not know its range"""
_AT, _BEYOND = 0.1, 0.1
"""parts of the situations: at the end of the range of validity, and 1.3 times as far"""


def random_calls(bundle: Bundle, count: int, seed: int) -> Iterator[Call]:
    """Calls of that many plans, each situation with a car that nothing is known of."""
    rng = np.random.default_rng(seed)
    for _ in range(count // PLANS):
        yield from _situation(bundle, rng)


def _situation(bundle: Bundle, rng: np.random.Generator) -> Iterator[Call]:
    valid, car = bundle.validity or _ANY_CAR, bundle.car or UNNAMED_CAR
    kind = rng.random()
    reach = 1.3 if kind < _BEYOND else 1.0

    def share(size: int | None = None) -> Any:
        found = rng.uniform(-1.0, 1.0, size)
        return reach * (np.sign(found) if kind < _BEYOND + _AT else found)

    slowest, fastest = valid.speed_mps[[0, -1]]
    vx = max(0.5 * (fastest + slowest + share() * (fastest - slowest)), 0.5 * slowest, 1.0)

    def near(limits: Array) -> float:
        return float(share() * np.interp(vx, valid.speed_mps, limits))

    curvature = near(valid.curvature_per_m)
    ey_m = 1.0 * share()
    motion = (vx, 0.03 * vx * share(), near(valid.lateral_mps2) / vx)
    state = np.array([*motion, vx * PERIOD_S, ey_m, 0.1 * share()])
    line = np.array([ey_m, 0.0, 0.0, 0.0]) + share(4) * [0.8, 0.06, 1e-3, 2e-5]
    speed = max(vx + 5.0 * share(), 0.0), 2.0 * share()
    path = PathReference(*np.append(line, speed).tolist())
    ahead = curvature * (1.0 + 0.3 * np.cumsum(share(5)))
    preview = CurvaturePreview(float(rng.uniform(4.0, 20.0)), *ahead.tolist())
    pedals = (rng.random(), 0.0) if rng.random() < 0.5 else (0.0, 80.0 * rng.random())
    previous = ControlInput(*pedals, near(valid.steer_rad))
    under_way = tuple(
        previous._replace(steer_rad=previous.steer_rad + 0.05 * share())
        for _ in range(rng.integers(4))
    )
    yield Call("reset")
    yield Call("resume", (previous,))
    most_rad = car.largest_plan_rad(vx, bundle.largest_steer_rad)
    yield Call("limit_steering", (max(most_rad, abs(previous.steer_rad)), inf))
    for _ in range(PLANS):
        yield Call("observe", (VehicleState(*state.tolist()), previous))
        now = (curvature, path, previous, preview if rng.random() < 0.9 else None, under_way)
        yield Call("plan", (None, *now))
        yield Call("prepare")
        state += 0.01 * state * rng.standard_normal(len(state))
