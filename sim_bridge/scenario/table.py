"""`Table`: a quantity over distance or time, as polynomials of third order between knots.

Before the first and after the last knot the value is constant.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial, polynomial

from rt_controller.contract.arrays import Array


class Interpolation(StrEnum):
    """How a table continues between its knots."""

    LINEAR = "linear"
    """straight lines; of curvature: clothoids"""
    STEP = "step"
    """the value of a knot holds until the next one"""
    PCHIP = "pchip"
    """without overshoot, with zero slope at both ends: `scipy.interpolate.PchipInterpolator`"""
    SPLINE = "spline"
    """cubic spline, twice differentiable, with zero slope at both ends; may overshoot"""


class Point(NamedTuple):
    """A place in a table and the value there."""

    x: float
    value: float


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Pieces of third order: sum over k of coefficients[i, k] (x - starts[i])^k."""

    starts: Array
    """(n,), increasing"""
    coefficients: Array
    """(n, 4), ascending powers; the last piece is constant"""

    def __call__(self, x: Array) -> Array:
        """Values at `x`, same shape."""
        piece = np.maximum(np.searchsorted(self.starts, x, "right") - 1, 0)
        d = np.maximum(x - self.starts[piece], 0.0)
        c = self.coefficients[piece]
        return np.asarray(c[..., 0] + d * (c[..., 1] + d * (c[..., 2] + d * c[..., 3])))

    def at(self, x: float) -> float:
        """The value at one place."""
        piece = max(int(self.starts.searchsorted(x, "right")) - 1, 0)
        d = max(x - float(self.starts[piece]), 0.0)
        c0, c1, c2, c3 = self.coefficients[piece].tolist()
        return float(c0 + d * (c1 + d * (c2 + d * c3)))

    def slope_at(self, x: float) -> float:
        """The derivative at one place; at a knot that of the piece after it."""
        piece = int(np.searchsorted(self.starts, x, "right")) - 1
        if piece < 0:
            return 0.0
        d = x - float(self.starts[piece])
        _, c1, c2, c3 = self.coefficients[piece].tolist()
        return float(c1 + d * (2.0 * c2 + d * 3.0 * c3))

    @property
    def is_constant(self) -> bool:
        """True if the value is the same everywhere."""
        return len(self.starts) == 1

    @property
    def end(self) -> float:
        """The last knot."""
        return float(self.starts[-1])

    def lowest(self) -> Point:
        """Place and size of the smallest value."""
        return min(self._candidates(), key=lambda point: point.value)

    def highest(self) -> Point:
        """Place and size of the largest value."""
        return max(self._candidates(), key=lambda point: point.value)

    def scaled(self, factor: float) -> "Table":
        """The table with all values times `factor`."""
        return Table(self.starts, factor * self.coefficients)

    def backwards(self, length: float) -> "Table":
        """The table seen from its place `length`, towards 0."""
        starts, coefficients = [], []
        ends = [*self.starts[1:].tolist(), inf]
        for start, end, c in zip(self.starts.tolist(), ends, self.coefficients, strict=True):
            last = min(end, length)
            if last <= max(start, 0.0):
                continue
            starts.append(length - last)
            mirrored: Array = Polynomial(c)(Polynomial((last - start, -1.0))).coef.astype(float)
            coefficients.append(np.pad(mirrored, (0, 4 - len(mirrored))))
        starts.append(length - max(float(self.starts[0]), 0.0))
        coefficients.append(np.array([self.at(0.0), 0.0, 0.0, 0.0]))
        order = np.argsort(starts, kind="stable")
        return Table(np.array(starts)[order], np.array(coefficients)[order])

    def _candidates(self) -> list[Point]:
        """Both ends of each piece and the places without slope inside it."""
        points = [Point(float(self.starts[0]), float(self.coefficients[0, 0]))]
        ends = [*self.starts[1:].tolist(), self.end]
        for start, end, c in zip(self.starts.tolist(), ends, self.coefficients, strict=True):
            inside = [0.0, end - start]
            slope = polynomial.polyder(c)
            if np.any(slope[1:]):
                roots = polynomial.polyroots(np.trim_zeros(slope, "b"))
                real = roots.real[np.abs(roots.imag) < 1e-12]
                inside += [d for d in real.tolist() if 0.0 < d < end - start]
            points += [Point(start + d, float(polynomial.polyval(d, c))) for d in inside]
        return points


def joined(tables: Sequence[Table], lengths: Sequence[float]) -> Table:
    """The first `length` of each table, in a row."""
    starts, coefficients, at = [], [], 0.0
    for table, length in zip(tables, lengths, strict=True):
        if table.starts[0] > 0.0:
            starts.append(at)
            coefficients.append(constant(table.at(0.0)).coefficients[0])
        within = table.starts < length
        starts += (at + np.maximum(table.starts[within], 0.0)).tolist()
        coefficients += list(table.coefficients[within])
        at += length
    last = constant(tables[-1].at(lengths[-1]))
    return Table(np.array([*starts, at]), np.array([*coefficients, last.coefficients[0]]))


def constant(value: float) -> Table:
    """A table with one value."""
    return Table(np.zeros(1), np.array([[value, 0.0, 0.0, 0.0]]))


def through(
    x: Sequence[float], values: Sequence[float], interpolation: Interpolation = Interpolation.LINEAR
) -> Table:
    """The table through knots; `x` increases strictly and has as many entries as `values`."""
    knots, y = np.asarray(x, dtype=np.float64), np.asarray(values, dtype=np.float64)
    coefficients = np.zeros((len(knots), 4))
    coefficients[:, 0] = y
    if len(knots) > 1:
        if interpolation is Interpolation.LINEAR:
            coefficients[:-1, 1] = np.diff(y) / np.diff(knots)
        elif interpolation is not Interpolation.STEP:
            from scipy.interpolate import CubicSpline, PchipInterpolator

            if interpolation is Interpolation.PCHIP:
                # With one more knot of the same value on each side both ends have zero slope.
                wider = (2.0 * knots[0] - knots[1], *knots, 2.0 * knots[-1] - knots[-2])
                found = PchipInterpolator(wider, (y[0], *y, y[-1])).c[:, 1:-1]
            else:
                found = CubicSpline(knots, y, bc_type="clamped").c
            coefficients[:-1] = found[::-1].T
    return Table(knots, coefficients)


class Ramp(NamedTuple):
    """A piece of a table that is linear, and need not continue the piece before it."""

    length: float
    first: float
    last: float


def chained(ramps: Sequence[Ramp]) -> Table:
    """The table of linear pieces in a row; each may begin with a jump."""
    starts = np.concatenate(([0.0], np.cumsum([ramp.length for ramp in ramps])))
    coefficients = np.zeros((len(starts), 4))
    for row, ramp in zip(coefficients, ramps, strict=False):
        row[:2] = ramp.first, (ramp.last - ramp.first) / ramp.length
    coefficients[-1, 0] = ramps[-1].last if ramps else 0.0
    return Table(starts, coefficients)
