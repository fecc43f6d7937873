"""Compiled functions that use what the translation to C covers."""

from math import ceil, exp, floor, hypot, pi
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from sim_bridge.plant.jit import compiled

N = 4
_SCALE = 2.5
WEIGHTS = (0.5, 0.25, 0.125)


class Point(NamedTuple):
    x: float
    y: float = 1.0


class Table(NamedTuple):
    speeds: tuple[float, ...]
    torques: tuple[tuple[float, ...], ...]
    count: int
    is_steep: bool
    centre: Point


class Curve(NamedTuple):
    """Arrays of parameters are tables, like tuples of numbers."""

    xs: Array
    ys: tuple[float, ...]


class Parts(NamedTuple):
    """Two curves of different lengths."""

    front: Curve
    rear: Curve
    map: Array


PARTS = Parts(
    Curve(np.array([-1.0, 0.0, 2.0]), (4.0, 1.0, 3.0)),
    Curve(np.array([0.0, 1.0]), (0.0, 5.0)),
    np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
)
LEVELS = np.array([0.5, 0.75])


class Buffers(NamedTuple):
    one: Array
    other: Array


TABLE = Table((0.0, 1.0, 4.0), ((1.0, 2.0), (3.0, 5.0), (8.0, 13.0)), 3, True, Point(0.5, -0.5))
ORIGIN = Point(0.25, 0.75)


@compiled
def arithmetic(a: float, b: float, i: int, j: int) -> float:
    """Signs, precedence and whole numbers as in Python."""
    mixed = a - (b - i) * j - a / (b * b + 1.0) / 2 + -a * -2.0 - (a + b) - (i - (j - 1))
    whole = (i + j) // 7 + (i - j) % 5 + i % -3
    return mixed + whole / 4 + a % 2.0 + a % -1.5


@compiled
def raised(a: float, b: float) -> float:
    """As numba: whole exponents by repeated multiplication."""
    return b**2 + abs(b) ** 3 + 2.0**-2 + (a * a + 1.0) ** 0.5 + abs(a) ** b


@compiled
def functions(a: float, b: float, i: int) -> float:
    number = floor(a) + ceil(b) + round(a) + int(b) + abs(i) + i
    return number + hypot(a, b) + exp(-abs(a)) + np.arctan2(a, b) + np.sqrt(b * b) + float(i)


@compiled
def extremes(a: float, b: float, c: float, i: int) -> float:
    return min(a, b, c) + 10.0 * max(a, b, c) + 100.0 * min(i, 3) + max(a, i)


@compiled
def smaller(a: float, b: float) -> float:
    return min(a, b)


@compiled
def conditions(a: float, b: float, i: int) -> int:
    between = -1.0 < a <= b < 5.0
    if between and i not in (2, 3):
        return 1
    if (a < 0.0 and b < 0.0) or i > 5 or i in (-4, -2):
        return 2
    if i < -5:
        return 3
    if smaller(a, b) > 0.0:
        return 4 if a > b else 5 if a > 1.0 else 6
    return 7


@compiled
def loops(n: int, limit: float) -> float:
    total = 0.0
    last = -1.0
    for i in range(n):
        if i > 0:
            total += last
        if i == 5:
            continue
        last = i * 0.5
        for j in range(i, 0, -2):
            total += j
            if total > limit:
                break
    for i in range(2, n, 3):
        total -= i
    i = 3
    while total > limit:
        total *= 0.5
        i += 1
    return total + i


@compiled
def over_tuples(a: float, points: tuple[Point, Point], i: int) -> float:
    total = 0.0
    for weight in WEIGHTS:
        for first in (2, i, i - 1):
            total += weight * first
    for point in points:
        total += point.x * point.y
    first = 3.0 * a
    return total + first


@compiled
def bounds_once(n: int) -> int:
    """Python evaluates the end of a range once."""
    count = 0
    for _ in range(n):
        n = n - 1
        count += 1
    return count


@compiled
def branches(a: float) -> float:
    if a > 0.0:
        factor = 2
        shift = a
    else:
        factor = 0.5
        shift = 1
    start = 0
    start += a
    return factor * shift + start


@compiled
def swapped(a: float, b: float) -> tuple[float, float]:
    a, b = b, a + b
    c, d = a, b
    c = d = c + d
    return c, d - a


@compiled
def tuples(p: Point, table: Table, i: int) -> float:
    x, y = p
    other = Point(y=x, x=y)
    plain = Point(3.0)
    centre, speeds = table.centre, table.speeds
    total = other.x - other.y + plain.y + centre.x + ORIGIN.y + p[1] + p[-2]
    total += speeds[i % len(speeds)] + table.speeds[-1] + table.torques[i % 3][i % 2]
    total += WEIGHTS[i % 3] + _SCALE + len(table.torques) + (1.0 if table.is_steep else 0.0)
    first, second = swapped(x, y)
    both = (first, second)
    return total + both[0] - both[i % 2] + p[i % 2]


@compiled
def interpolated(x: float, xs: tuple[float, ...], ys: tuple[float, ...]) -> float:
    for i in range(len(xs) - 1):
        if x < xs[i + 1]:
            share = (x - xs[i]) / (xs[i + 1] - xs[i])
            return ys[i] + share * (ys[i + 1] - ys[i])
    return ys[len(ys) - 1]


@compiled
def curve_at(x: float, curve: Curve) -> float:
    xs, ys = curve.xs, curve.ys
    for i in range(len(xs) - 1):
        if x < xs[i + 1]:
            return ys[i] + (x - xs[i]) / (xs[i + 1] - xs[i]) * (ys[i + 1] - ys[i])
    return ys[-1]


@compiled
def tables(x: float, parts: Parts, i: int) -> float:
    total = curve_at(x, parts.front) + 10.0 * curve_at(x, parts.rear)
    total += parts.map[i % 2, (i + 1) % 3] + parts.map[1, 0] + LEVELS[i % 2]
    total += parts.map.shape[0] + 10 * parts.map.shape[1] + 100 * len(parts.map)
    return total + np.interp(x, parts.front.xs, parts.front.ys) + np.clip(x, -0.5, 0.5)


@compiled
def two_lengths(x: float) -> float:
    return interpolated(x, (0.0, 1.0), (2.0, 4.0)) + interpolated(
        x, (0.0, 1.0, 3.0), (1.0, 0.0, 5.0)
    )


@compiled
def count_up(values: Array, i: int) -> float:
    values[i] += 1.0
    return values[0] + 10.0 * values[1]


@compiled
def in_order(values: Array) -> float:
    """The calls write to the array that they and their neighbours read."""
    readings = (values[0], count_up(values, 0), count_up(values, 1), count_up(values, 0))
    point = Point(count_up(values, 1), values[1])
    return (
        readings[0] + 2.0 * readings[1] + 3.0 * readings[2] + 4.0 * readings[3] + point.x * point.y
    )


@compiled
def fresh() -> Buffers:
    return Buffers(np.zeros(N), np.zeros(2 * N))


@compiled
def wrapped_fresh(start: float) -> Buffers:
    buffers = fresh()
    buffers.one[0] = start
    return buffers


@compiled
def powers(base: float) -> Array:
    values = np.zeros(N)
    values[0] = 1.0
    for i in range(1, N):
        values[i] = values[i - 1] * base
    return values


@compiled
def arrays(matrix: Array, out: Array) -> float:
    """Rows, pieces, lengths and new arrays of two functions."""
    first = wrapped_fresh(7.0)
    second = wrapped_fresh(11.0)
    row = matrix[1]
    row[0] = 5.0
    total = 0.0
    for i in range(len(matrix)):
        for j in range(matrix.shape[1]):
            total += matrix[i, j] * (i + 1)
    third = powers(total)
    local = np.array((1.0, 2.0, 3.0))
    small = np.empty((2, 3))
    for j in range(3):
        small[1, j] = local[j] + first.one[0] - second.one[0] + third[1]
    count_up(out[1:], 1)
    count_up(matrix[1:3][0], 2)
    out[0] = small[1, 2] + first.other[3]
    return total


class Words(NamedTuple):
    auto: float
    short: float


@compiled
def names(double: float, log: float, register: float) -> float:
    """Words of C, names of its functions, names that differ in an underscore only."""
    int_ = double + pi
    exp_ = exp(log) * register
    _exp, double_ = 3.0 * exp_, int_ - 1.0
    c_samples_smaller = smaller(double, _exp)
    words = Words(auto=double_, short=c_samples_smaller)
    return int_ + exp_ + words.auto * words[1] + words[int(c_samples_smaller) % 2]


@compiled
def nothing(values: Array) -> None:
    if values[0] > 0.0:
        return
    values[0] = 1.0
