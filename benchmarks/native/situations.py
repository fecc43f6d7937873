"""Random situations of a car."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from offline.targets.recorded_drives import Situation
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

PERIODS = 2
"""that follow each other: a first plan, and one that was prepared"""
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


def random_situations(bundle: Bundle, count: int, seed: int) -> list[Situation]:
    """That many situations, pairs of a restart and of a period that follows on it."""
    rng = np.random.default_rng(seed)
    return [now for _ in range(count // PERIODS) for now in _periods(bundle, rng)]


def _periods(bundle: Bundle, rng: np.random.Generator) -> Iterator[Situation]:
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
    most_rad = max(car.largest_plan_rad(vx, bundle.largest_steer_rad), abs(previous.steer_rad))
    for i in range(PERIODS):
        yield Situation(
            is_restart=i == 0,
            state=VehicleState(*state.tolist()),
            curvature_per_m=curvature,
            path=path,
            preview=preview if rng.random() < 0.9 else None,
            applied=previous,
            previous=previous,
            under_way=under_way,
            most_steer_rad=most_rad,
        )
        state += 0.01 * state * rng.standard_normal(len(state))
