"""The wanted lateral position on the road: moves, tables and sines."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, pi
from typing import NamedTuple, Protocol

import numpy as np

from rt_controller.contract.arrays import Array
from sim_bridge.scenario.table import Table


class Lateral(Protocol):
    """A wanted lateral deviation from the reference line, positive to the left."""

    @property
    def is_over_time(self) -> bool:
        """True if it depends on the time, False if on the arc length."""
        ...

    def ey_m(self, s_m: Array, time_s: Array) -> Array:
        """The deviation at arc lengths `s_m`, reached at times `time_s`; same shape."""
        ...

    def knots(self) -> list[float]:
        """Where its law changes: arc lengths or times."""
        ...

    def shortest_piece(self) -> "Piece":
        """The shortest part of its law: checks look at the path on a grid."""
        ...


class Piece(NamedTuple):
    """A part of the law of a lateral position."""

    name: str
    """what messages call it"""
    length: float
    """in m or s"""
    parts: int = 1
    """in which the path has to be known"""


class Move(NamedTuple):
    """A minimum-jerk move, of fifth order in arc length, from the present position to `to_m`."""

    start_m: float
    """arc length at which the move begins"""
    length_m: float
    to_m: float


@dataclass(frozen=True, slots=True)
class Moves:
    """Moves in a row, with zero slope and curvature at both ends of each; they do not overlap."""

    moves: Sequence[Move] = ()
    is_over_time: bool = False

    def ey_m(self, s_m: Array, time_s: Array) -> Array:
        """See `Lateral`."""
        if not self.moves:
            return np.zeros_like(s_m)
        start_m, length_m, to_m = np.array(self.moves).T
        before_m = np.concatenate(([0.0], to_m[:-1]))
        k = np.maximum(np.searchsorted(start_m, s_m, "right") - 1, 0)
        t = np.clip((s_m - start_m[k]) / length_m[k], 0.0, 1.0)
        rise = t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
        return np.asarray(before_m[k] + (to_m[k] - before_m[k]) * rise)

    def knots(self) -> list[float]:
        """See `Lateral`."""
        return [edge for m in self.moves for edge in (m.start_m, m.start_m + m.length_m)]

    def shortest_piece(self) -> Piece:
        """See `Lateral`."""
        return Piece("moves", min((move.length_m for move in self.moves), default=inf))


@dataclass(frozen=True, slots=True)
class LateralTable:
    """A table over arc length or time."""

    table: Table
    is_over_time: bool = False

    def ey_m(self, s_m: Array, time_s: Array) -> Array:
        """See `Lateral`."""
        return self.table(time_s if self.is_over_time else s_m)

    def knots(self) -> list[float]:
        """See `Lateral`."""
        return list(self.table.starts.tolist())

    def shortest_piece(self) -> Piece:
        """See `Lateral`."""
        return Piece(
            "distances of the knots", float(np.min(np.diff(self.table.starts), initial=inf))
        )


@dataclass(frozen=True, slots=True)
class Sine:
    """A sine over arc length or time.

    Its amplitude grows from zero over `fade_periods` with zero slope, because a sine that begins
    at once has a step of heading; it decreases alike before the end.
    """

    amplitude_m: float
    period: float
    """length in m, or duration in s"""
    is_over_time: bool
    start: float = 0.0
    """arc length or time of the first zero"""
    periods: float = inf
    """number of periods, those of growing and decreasing included"""
    fade_periods: float = 1.0

    def ey_m(self, s_m: Array, time_s: Array) -> Array:
        """See `Lateral`."""
        x = time_s if self.is_over_time else s_m
        turns = np.clip((x - self.start) / self.period, 0.0, self.periods)
        grown = np.ones_like(turns)
        if self.fade_periods > 0.0:
            rise = np.minimum(turns, self.periods - turns) / self.fade_periods
            rise = np.clip(rise, 0.0, 1.0)
            grown = rise**3 * (10.0 - 15.0 * rise + 6.0 * rise**2)
        return np.asarray(self.amplitude_m * grown * np.sin(2.0 * pi * turns))

    def knots(self) -> list[float]:
        """See `Lateral`."""
        last = [] if self.periods == inf else [self.start + self.periods * self.period]
        return [self.start, *last]

    def shortest_piece(self) -> Piece:
        """See `Lateral`."""
        name = "frequency_hz with a wavelength" if self.is_over_time else "wavelength_m"
        return Piece(name, self.period, 8)


@dataclass(frozen=True, slots=True, eq=False)
class LateralOfDrive:
    """A law over time, at the times at which a drive at the wanted speed reaches each place.

    The path is fixed to the road by this: a car that is slower, in a stop for example, can follow
    it, too.
    """

    over_time: Lateral
    s_m: Array
    """(n,), increasing"""
    time_s: Array
    """(n,)"""
    is_over_time: bool = False

    def ey_m(self, s_m: Array, time_s: Array) -> Array:
        """See `Lateral`."""
        return self.over_time.ey_m(s_m, np.interp(s_m, self.s_m, self.time_s))

    def knots(self) -> list[float]:
        """See `Lateral`."""
        return [float(s) for s in np.interp(self.over_time.knots(), self.time_s, self.s_m)]

    def shortest_piece(self) -> Piece:
        """See `Lateral`."""
        slowest_mps = float(np.min(np.diff(self.s_m) / np.diff(self.time_s)))
        piece = self.over_time.shortest_piece()
        return piece._replace(length=piece.length * slowest_mps)


def overlaps(moves: Sequence[Move]) -> list[str]:
    """A line for each move that begins before the end of the one before it."""
    problems, end_m = [], -inf
    for i, move in enumerate(moves):
        if move.start_m < end_m:
            problems.append(
                f"moves[{i}].start_m: expected at least {end_m:g} (moves must not overlap), found "
                f"{move.start_m:g}."
            )
        end_m = move.start_m + move.length_m
    return problems
