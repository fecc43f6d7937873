"""Compiled functions that leave what the translation to C covers; each states its refusal."""

from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from sim_bridge.plant.jit import compiled


class Pair(NamedTuple):
    a: float
    b: int


def plain(x: float) -> float:
    return x


SETTINGS = {"gain": 2.0}


@compiled
def uncompiled_call(x: float) -> float:
    """a call of plain"""
    return plain(x)


@compiled
def dictionary(x: float) -> float:
    """SETTINGS, a dict"""
    return x * SETTINGS["gain"]


@compiled
def text(x: float) -> float:
    """'left'"""
    side = "left"
    return x if side == "left" else -x


@compiled
def listed(x: float) -> float:
    """kind List"""
    values = [x, x]
    return values[0]


@compiled
def comprehension(x: float) -> float:
    """kind ListComp"""
    values = [x * i for i in range(3)]
    return values[0]


@compiled
def caught(x: float) -> float:
    """kind Try"""
    try:
        return 1.0 / x
    except ZeroDivisionError:
        return 0.0


@compiled
def raised(x: float) -> float:
    """kind Raise"""
    if x < 0.0:
        raise ValueError("negative")
    return x


@compiled
def recursive(x: float) -> float:
    """which calls itself"""
    return recursive(x - 1.0) if x > 0.0 else 0.0


@compiled
def unannotated(x) -> float:
    """x without a type"""
    return x


@compiled
def over_items(p: Pair) -> float:
    """a loop over something else than range"""
    total = 0.0
    for item in p:
        total += item
    return total


@compiled
def counter_after_loop(n: int) -> int:
    """the loop variable i after its loop"""
    for i in range(n):  # noqa: B007
        pass
    return i


@compiled
def counter_changed(n: int) -> int:
    """a new value for the loop variable i"""
    total = 0
    for i in range(n):
        i = i + 1  # noqa: PLW2901
        total += i
    return total


@compiled
def computed_length(n: int) -> float:
    """an array whose length is computed"""
    values = np.zeros(n)
    return values[0]


@compiled
def array_in_loop(n: int) -> float:
    """a new array in a loop"""
    total = 0.0
    for _ in range(n):
        values = np.zeros(3)
        total += values[0]
    return total


@compiled
def from_the_end(values: Array) -> float:
    """counts from the end"""
    return values[-1]


@compiled
def length_of_vector(values: Array) -> int:
    """the shape of an array of one dimension"""
    return values.shape[0]


@compiled
def len_of_vector(values: Array) -> int:
    """len() of an array of one dimension"""
    return len(values)


@compiled
def whole_array(values: Array) -> Array:
    """arithmetic of whole tuples or arrays"""
    return values + values


@compiled
def mixed_index(p: Pair, i: int) -> float:
    """items of several types"""
    return p[i]


@compiled
def two_types(x: float) -> float:
    """value with values of two types"""
    value = (x, x)
    value = x
    return value  # noqa: RET504


@compiled
def truth_of_number(x: float, y: float) -> float:
    """`and` or `or` of something else than conditions"""
    return x or y


@compiled
def two_array_results(values: Array, n: int) -> Array:
    """a second array for result"""
    result = values
    if n > 0:
        result = values[1:]
    return result


@compiled
def increased(values: Array) -> float:
    values[0] += 1.0
    return values[0]


@compiled
def order_lost(values: Array, x: float) -> float:
    """a call inside a condition"""
    return values[0] + increased(values) if x > 0.0 else 0.0


@compiled
def field_changed(p: Pair) -> float:
    """an assignment to a field"""
    p.a = 1.0
    return p.a


@compiled
def float_index(values: Array, x: float) -> float:
    """an index of type double"""
    return values[x]
