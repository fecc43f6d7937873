"""The wanted lateral position on the road: moves, sines and tables."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import inf, pi
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from rt_controller.contract.arrays import Array
from sim_bridge.scenario.limits import LARGEST_EY_M
from sim_bridge.scenario.table import Interpolation, constant
from sim_bridge.scenario.values import NotNegative, OverDistance, OverTime, require_within
from sim_bridge.toml_file import FileTable, Number, entries

NEAREST_KNOTS_M = 0.25
"""of a path: checks look at it on such a grid"""
Ey = Annotated[Number, Field(ge=-LARGEST_EY_M, le=LARGEST_EY_M)]


@dataclass(frozen=True, slots=True, eq=False)
class Lateral:
    """A wanted lateral deviation from the reference line, positive to the left."""

    law: Callable[[Array], Array]
    """from arc lengths in m, or times in s, to deviations in m; same shape"""
    is_over_time: bool = False

    def ey_m(self, s_m: Array, time_s: Array) -> Array:
        """The deviation at arc lengths `s_m`, reached at times `time_s`; same shape."""
        return self.law(time_s if self.is_over_time else s_m)


class Move(FileTable):
    """A minimum-jerk move, of fifth order in arc length, from the present position to `to_m`."""

    start_m: Number
    """arc length at which the move begins"""
    length_m: Annotated[Number, Field(ge=NEAREST_KNOTS_M)]
    to_m: Ey


class Moves(FileTable):
    """Moves in a row, with zero slope and curvature at both ends of each; they do not overlap."""

    kind: Literal["moves"]
    moves: Annotated[tuple[Move, ...], entries(0)]

    @model_validator(mode="after")
    def _require_order(self) -> Self:
        end_m = -inf
        for i, move in enumerate(self.moves):
            if move.start_m < end_m:
                raise ValueError(
                    f"moves[{i}].start_m: expected at least {end_m:g} (moves must not overlap), "
                    f"found {move.start_m:g}"
                )
            end_m = move.start_m + move.length_m
        return self

    @cached_property
    def columns(self) -> Array:
        """(3, n) start, length and target of each move."""
        return np.array([(m.start_m, m.length_m, m.to_m) for m in self.moves]).T

    def lateral(self) -> Lateral:
        """The path."""
        return Lateral(self._ey_m)

    def _ey_m(self, s_m: Array) -> Array:
        if not self.moves:
            return np.zeros_like(s_m)
        start_m, length_m, to_m = self.columns
        before_m = np.concatenate(([0.0], to_m[:-1]))
        k = np.maximum(np.searchsorted(start_m, s_m, "right") - 1, 0)
        t = np.clip((s_m - start_m[k]) / length_m[k], 0.0, 1.0)
        return np.asarray(before_m[k] + (to_m[k] - before_m[k]) * _smooth(t))


class Sine(FileTable):
    """A sine, by its length over distance or its frequency over time.

    Its amplitude grows from zero over `fade_periods` with zero slope, because a sine that begins
    at once has a step of heading; it decreases alike before the end.
    """

    kind: Literal["sine"]
    amplitude_m: Ey
    wavelength_m: Annotated[Number, Field(ge=8.0 * NEAREST_KNOTS_M)] | None = None
    frequency_hz: Annotated[Number, Field(gt=0.0, le=5.0)] | None = None
    start_s_m: NotNegative | None = None
    start_t_s: NotNegative | None = None
    periods: Annotated[Number, Field(ge=1.0)] = inf
    """number of periods, those of growing and decreasing included; inf: to the end"""
    fade_periods: Annotated[Number, Field(ge=0.0, le=100.0)] = 1.0

    @model_validator(mode="after")
    def _require_one_period(self) -> Self:
        if (self.wavelength_m is None) == (self.frequency_hz is None):
            raise ValueError("wavelength_m: expected it or frequency_hz, found both or none")
        right, wrong = "start_s_m with wavelength_m", "start_t_s"
        if self.wavelength_m is None:
            right, wrong = "start_t_s with frequency_hz", "start_s_m"
        if getattr(self, wrong) is not None:
            raise ValueError(f"{wrong}: expected {right}, found {wrong}")
        if self.periods < 2.0 * self.fade_periods:
            raise ValueError(
                f"periods: expected at least twice fade_periods, {2.0 * self.fade_periods:g}, "
                f"found {self.periods:g}"
            )
        return self

    def lateral(self) -> Lateral:
        """The path."""
        return Lateral(self._ey_m, self.wavelength_m is None)

    def _ey_m(self, x: Array) -> Array:
        start = self.start_s_m or self.start_t_s or 0.0
        period = self.wavelength_m or 1.0 / (self.frequency_hz or 1.0)
        turns = np.clip((x - start) / period, 0.0, self.periods)
        grown = np.ones_like(turns)
        if self.fade_periods > 0.0:
            rise = np.minimum(turns, self.periods - turns) / self.fade_periods
            grown = _smooth(np.clip(rise, 0.0, 1.0))
        return np.asarray(self.amplitude_m * grown * np.sin(2.0 * pi * turns))


def to_lateral(found: Any) -> Any:
    """The path that a file gives as a number, a table, moves or a sine; else what was found."""
    if isinstance(found, OverDistance | OverTime):
        if found.interpolation is Interpolation.STEP:
            raise ValueError("interpolation: expected linear, pchip or spline, found step")
        nearest_m = min((b - a for a, b in pairwise(found.x)), default=inf)
        if isinstance(found, OverDistance) and nearest_m < NEAREST_KNOTS_M:
            raise ValueError(
                f"s_m: expected knots {NEAREST_KNOTS_M:g} m apart or more, found {nearest_m:.3g} m"
            )
        table = found.table()
    elif isinstance(found, int | float):
        table = constant(found)
    else:
        return found.lateral() if isinstance(found, Moves | Sine) else found
    require_within(table, -LARGEST_EY_M, LARGEST_EY_M, "m")
    return Lateral(table, isinstance(found, OverTime))


def _smooth(t: Array) -> Array:
    """From 0 to 1 with zero slope and curvature at both ends; `t` is in 0..1."""
    return np.asarray(t**3 * (10.0 - 15.0 * t + 6.0 * t**2))
