"""Series of parts of test sets, ordered by one quantity: sideslip, braking, speed, friction, …"""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.evaluation.simulated_sets import BY_FRICTION, BY_MASS_FACTOR, SimulatedSet
from offline.evaluation.test_sets import (
    BRAKING,
    FAST,
    FRICTION,
    LIBRARY,
    MASS,
    NOISE,
    SET_NAMES,
    SLIDING,
    TestSet,
)
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import Schema

"""name of the series of whole test sets"""

SIDESLIP_DEG = (0.0, 2.0, 4.0, 6.0, 9.0, 16.0, np.inf)
"""limits of the parts; a simulated car that slides by more than 15 deg ends its episode"""
FIRST_SPEED_KMH = (0.0, 50.0, 80.0, 110.0, 145.0, np.inf)
FAST_KMH = (130.0, 150.0, 180.0, np.inf)
HARD_BRAKING_N = 75.0
"""half of the largest brake input"""


class Slice(NamedTuple):
    """Some trajectories of a test set."""

    label: str
    """value or range of the quantity, in the unit of the series"""
    of: str
    """name of the test set"""
    rows: NDArray[np.bool_]
    """(N,) True for the trajectories of the slice"""


class Series(NamedTuple):
    """Slices in the order of one quantity."""

    name: str
    quantity: str
    unit: str
    on: str
    """what the trajectories are, as the end of a sentence"""
    slices: tuple[Slice, ...]


def make_series(sets: Sequence[TestSet], schema: Schema) -> tuple[Series, ...]:
    """All series that these test sets and signals allow, whole test sets first.

    A slice without a trajectory is left out, and so is a series with a single slice.
    """
    tests = {test.name: test for test in sets}
    levels = {name.removeprefix(f"{NOISE}-"): name for name in tests if name.startswith(NOISE)}
    by_sideslip = "by the largest sideslip of the two seconds"
    brakes = f"{LIBRARY}, by the largest brake input"
    brakes += ", and straight stops" if BRAKING in tests else ""
    fast = f" and {FAST}" if FAST in tests else ""
    of_sets = _whole(tests, {name: name for name in SET_NAMES})
    others = (
        _series("sideslip", "peak sideslip", "deg", f"{LIBRARY}, {by_sideslip}",
                _by_sideslip(tests, LIBRARY, schema)),
        _series(SLIDING, "peak sideslip", "deg", f"{SLIDING}, {by_sideslip}",
                _by_sideslip(tests, SLIDING, schema)),
        _series(BRAKING, "brake", "", brakes, _by_braking(tests, schema)),
        _series("speed", "first speed", "km/h", f"{LIBRARY}{fast}, by the first speed",
                _by_speed(tests, schema)),
        _series(FRICTION, "road friction", "", "the same drivers on roads of different friction",
                _whole(tests, _names(BY_FRICTION))),
        _series(MASS, "mass", "times", "the same drivers in cars of different mass",
                _whole(tests, _names(BY_MASS_FACTOR))),
        _series(NOISE, "noise", "times", f"{LIBRARY} with noise on what the models hear",
                _whole(tests, {"0": LIBRARY, **levels})),
    )  # fmt: skip
    return (
        _series("sets", "test set", "", "all test sets", of_sets),
        *(each for each in others if len(each.slices) > 1),
    )


def _series(name: str, quantity: str, unit: str, on: str, slices: Iterable[Slice]) -> Series:
    return Series(name, quantity, unit, on, tuple(slices))


def _names(by_value: dict[float, SimulatedSet]) -> dict[str, str]:
    return {f"{value:g}": which.name for value, which in by_value.items()}


def _whole(tests: dict[str, TestSet], labels: dict[str, str]) -> Iterable[Slice]:
    """Whole test sets, given their names by label."""
    for label, name in labels.items():
        if name in tests:
            yield Slice(label, name, np.ones(tests[name].n_trajectories, dtype=np.bool_))


def _by_sideslip(tests: dict[str, TestSet], of: str, schema: Schema) -> Iterable[Slice]:
    names = schema.state_names
    if of not in tests or not {"vx_mps", "vy_mps"} <= set(names):
        return
    x = tests[of].trajectories.x
    vx, vy = (x[..., names.index(name)].astype(np.float64) for name in ("vx_mps", "vy_mps"))
    peak_deg = np.degrees(np.abs(np.arctan2(vy, vx))).max(axis=1)
    yield from _between(of, peak_deg, SIDESLIP_DEG)


def _by_braking(tests: dict[str, TestSet], schema: Schema) -> Iterable[Slice]:
    if LIBRARY not in tests or "brake_n" not in schema.input_names:
        return
    column = schema.input_names.index("brake_n")
    peak_n = tests[LIBRARY].trajectories.u[..., column].max(axis=1)
    for label, rows in (
        ("none", peak_n == 0.0),
        (f"below {HARD_BRAKING_N:g} N", (peak_n > 0.0) & (peak_n < HARD_BRAKING_N)),
        (f"{HARD_BRAKING_N:g} N and more", peak_n >= HARD_BRAKING_N),
    ):
        if rows.any():
            yield Slice(label, LIBRARY, rows)
    yield from _whole(tests, {"straight, 150 N": BRAKING})


def _by_speed(tests: dict[str, TestSet], schema: Schema) -> Iterable[Slice]:
    if "vx_mps" not in schema.state_names:
        return
    column = schema.state_names.index("vx_mps")
    for of, limits in ((LIBRARY, FIRST_SPEED_KMH), (FAST, FAST_KMH)):
        if of in tests:
            first_kmh = 3.6 * tests[of].trajectories.x[:, 0, column].astype(np.float64)
            yield from _between(of, first_kmh, limits)


def _between(of: str, values: Array, limits: Sequence[float]) -> Iterable[Slice]:
    """Slices between neighbouring limits, the lower one included."""
    for low, high in pairwise(limits):
        rows = (values >= low) & (values < high)
        if rows.any():
            label = f"{low:g} to {high:g}" if np.isfinite(high) else f"{low:g} and more"
            yield Slice(label, of, rows)
