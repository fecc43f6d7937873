"""Where a model is valid: the ranges of the data that it was trained with.

Outside of them it extrapolates. Nothing stops for that: a person is told before and after a drive,
and the heartbeat has a bit for it.
"""

from bisect import bisect_right
from collections.abc import Sequence
from math import degrees
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array


class Validity(NamedTuple):
    """Ranges of the training data, SI units; largest values are magnitudes, left as right."""

    speed_mps: Array
    """(K,), K >= 2, ascending, from the lowest to the highest speed"""
    lateral_mps2: Array
    """(K,) largest v_x times yaw rate near each of these speeds; linear between them"""
    steer_rad: Array
    """(K,) the same of the steering wheel"""
    curvature_per_m: Array
    """(K,) the same of the roads"""
    conditions: Array
    """(4, 2) lowest and highest value of each of `CONDITIONS`; (0, 2): not known"""


class Shown(NamedTuple):
    """How a quantity is named and printed."""

    name: str
    unit: str
    factor: float = 1.0
    """of the printed value to the one in SI units"""
    tolerance: float = 0.0
    """in SI units: so far outside of its range a value is not named"""

    def number(self, value: float) -> str:
        """The value as printed, without unit."""
        printed = self.factor * value + 0.0  # not "-0"
        return f"{printed:.2g}" if abs(printed) < 10.0 else f"{printed:.0f}"

    def text(self, value: float) -> str:
        """The value with name and unit."""
        return f"{self.name} {self.number(value)} {self.unit}".rstrip()

    def span(self, limits: Sequence[float]) -> str:
        """Lowest and highest value, once if they are printed alike."""
        low, high = map(self.number, limits)
        return f"{low if low == high else f'{low} to {high}'} {self.unit}".rstrip()


_DEG = degrees(1.0)
QUANTITIES = (
    Shown("speed", "km/h", 3.6),
    Shown("lateral acceleration", "m/s²"),
    Shown("steering wheel", "deg", _DEG),
    Shown("curvature", "1/m"),
)
"""of the motion, in the order of the first fields of `Validity`"""
CONDITIONS = (
    Shown("friction", "", tolerance=0.1),
    Shown("grade", "%", 100.0, tolerance=0.02),
    Shown("bank", "deg", _DEG, tolerance=0.02),
    Shown("load", "kg", tolerance=100.0),
)
"""that a controller cannot measure"""


class Excess(NamedTuple):
    """The quantity that is furthest outside of its range."""

    share: float
    """value relative to its limit, above 1"""
    quantity: int
    """index into `QUANTITIES`"""
    value: float
    limit: float

    @property
    def text(self) -> str:
        """Value and limit in one phrase."""
        shown = QUANTITIES[self.quantity]
        of = "below" if self.is_below else "of"
        numbers = f"{shown.number(abs(self.value))} {of} {shown.number(self.limit)} {shown.unit}"
        return f"{shown.name} {numbers}"

    @property
    def is_below(self) -> bool:
        """True for a speed below the lowest one of the training."""
        return self.quantity == 0 and self.value < self.limit

    def named(self, speed_mps: float) -> str:
        """The value at its speed, and the limit in brackets."""
        shown = QUANTITIES[self.quantity]
        speed = f" at {QUANTITIES[0].number(speed_mps)} km/h" if self.quantity else ""
        limit = f"{'from' if self.is_below else 'to'} {shown.number(self.limit)}"
        return f"{shown.text(abs(self.value))}{speed} (the model was trained {limit})"


_UNBOUNDED, _LEAST = 1e9, 1e-9
"""of a limit"""


class TrainedRange:
    """The comparison of a motion with a `Validity`."""

    def __init__(self, validity: Validity, is_path_exact: bool) -> None:
        """`is_path_exact`: the curvature acts through the motion only, and is not compared."""
        speeds = validity.speed_mps
        columns = np.maximum(np.stack(validity[1 : len(QUANTITIES)], axis=1), _LEAST)
        if is_path_exact:
            columns[:, -1] = _UNBOUNDED
        slopes = np.diff(columns, axis=0) / np.diff(speeds)[:, None]
        self._speeds = speeds.tolist()
        pieces = np.column_stack([speeds[:-1], columns[:-1], slopes]).tolist()
        self._pieces = [tuple(piece) for piece in pieces]
        self._inner = self._speeds[1:-1]

    def excess(
        self, speed_mps: float, lateral_mps2: float, steer_rad: float, curvature_per_m: float
    ) -> Excess | None:
        """What is furthest outside; None: nothing."""
        slowest, fastest = self._speeds[0], self._speeds[-1]
        speed = slowest if speed_mps < slowest else fastest if speed_mps > fastest else speed_mps
        piece = self._pieces[bisect_right(self._inner, speed)]
        begin, lateral, steer, curvature, by_lateral, by_steer, by_curvature = piece
        ahead = speed - begin
        lateral += by_lateral * ahead
        steer += by_steer * ahead
        curvature += by_curvature * ahead
        if (
            speed == speed_mps
            and -lateral <= lateral_mps2 <= lateral
            and -steer <= steer_rad <= steer
            and -curvature <= curvature_per_m <= curvature
        ):
            return None
        share, quantity = speed_mps / max(speed, _LEAST), 0
        if share < 1.0:
            share = speed / max(speed_mps, _LEAST)
        if abs(lateral_mps2) > share * lateral:
            share, quantity = abs(lateral_mps2) / lateral, 1
        if abs(steer_rad) > share * steer:
            share, quantity = abs(steer_rad) / steer, 2
        if abs(curvature_per_m) > share * curvature:
            share, quantity = abs(curvature_per_m) / curvature, 3
        value = (speed_mps, lateral_mps2, steer_rad, curvature_per_m)[quantity]
        return Excess(share, quantity, value, (speed, lateral, steer, curvature)[quantity])
