"""The translation to C computes what the Python functions compute, or refuses with the place."""

import copy
from pathlib import Path
from typing import Any

import c_refused
import c_samples
import numpy as np
import pytest
from c_compiler import needs_c_compiler
from c_library import CLibrary, build, flat
from c_samples import Point
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sim_bridge.c_code.c_types import ArrayType
from sim_bridge.c_code.program import CProgram
from sim_bridge.c_code.refusal import UnsupportedCodeError

pytestmark = needs_c_compiler

MATRIX = np.arange(12.0).reshape(4, 3)
SHOWN = {
    c_samples.arithmetic: (1.0, 2.0, 3, 4),
    c_samples.raised: (1.0, 2.0),
    c_samples.functions: (1.0, 2.0, 3),
    c_samples.extremes: (1.0, 2.0, 3.0, 4),
    c_samples.conditions: (1.0, 2.0, 3),
    c_samples.loops: (9, 30.0),
    c_samples.over_tuples: (1.0, (Point(1.0, 2.0), Point(3.0, 4.0)), 2),
    c_samples.bounds_once: (6,),
    c_samples.branches: (1.0,),
    c_samples.swapped: (1.0, 2.0),
    c_samples.tuples: (Point(1.0, 2.0), c_samples.TABLE, 1),
    c_samples.tables: (0.5, c_samples.PARTS, 1),
    c_samples.two_lengths: (0.5,),
    c_samples.in_order: (np.zeros(2),),
    c_samples.arrays: (MATRIX, np.zeros(4)),
    c_samples.names: (1.0, 2.0, 3.0),
    c_samples.nothing: (np.zeros(1),),
}


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> CLibrary:
    return build(
        tmp_path_factory.mktemp("c"), list(SHOWN.items()), (c_samples.TABLE, c_samples.PARTS)
    )


def assert_same(library: CLibrary, kernel: Any, *arguments: Any) -> None:
    """Result and arrays of the C function are those of the Python function."""
    in_c, in_python = copy.deepcopy(arguments), copy.deepcopy(arguments)
    result = library.call(kernel, *in_c)
    expected = kernel.py_func(*in_python)
    if expected is not None:
        np.testing.assert_array_equal(flat(result), flat(expected))
    for one, other in zip(in_c, in_python, strict=True):
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other)


floats = st.floats(-20.0, 20.0)
ints = st.integers(-9, 9)
few = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@few
@given(a=floats, b=floats, c=floats, i=ints, j=ints)
def test_numbers_are_those_of_python(
    library: CLibrary, a: float, b: float, c: float, i: int, j: int
) -> None:
    assert_same(library, c_samples.arithmetic, a, b, i, j)
    # Python's own hypot differs from that of C, which numba calls, in the last digit.
    expected = c_samples.functions.py_func(a, b, i)
    assert library.call(c_samples.functions, a, b, i) == pytest.approx(expected, rel=1e-13)
    assert_same(library, c_samples.extremes, a, b, c, i)
    assert_same(library, c_samples.conditions, a, b, i)
    assert_same(library, c_samples.branches, a)
    assert_same(library, c_samples.swapped, a, b)
    assert_same(library, c_samples.names, a, b, c)
    assert_same(library, c_samples.two_lengths, abs(a) / 5.0)


@few
@given(n=st.integers(0, 12), limit=st.floats(1.0, 60.0), x=floats, y=floats)
def test_loops_and_tuples_are_those_of_python(
    library: CLibrary, n: int, limit: float, x: float, y: float
) -> None:
    assert_same(library, c_samples.loops, n, limit)
    assert_same(library, c_samples.bounds_once, n)
    assert_same(library, c_samples.over_tuples, x, (Point(x, y), Point(y, 2.0)), n)
    assert_same(library, c_samples.tuples, Point(x, y), c_samples.TABLE, n)
    expected = c_samples.tables.py_func(x / 10.0, c_samples.PARTS, n)
    in_c = library.call(c_samples.tables, x / 10.0, c_samples.PARTS, n)
    assert in_c == pytest.approx(expected, rel=1e-14)


@few
@given(a=st.floats(-3.0, 3.0), b=st.floats(-3.0, 3.0))
def test_powers_are_those_of_python_up_to_rounding(library: CLibrary, a: float, b: float) -> None:
    expected = c_samples.raised.py_func(abs(a) + 0.1, b)
    assert library.call(c_samples.raised, abs(a) + 0.1, b) == pytest.approx(expected, rel=1e-14)


def test_a_nan_takes_the_same_way_through_minimum_and_maximum(library: CLibrary) -> None:
    for arguments in ((np.nan, 1.0, 2.0, 1), (1.0, np.nan, 2.0, 1), (1.0, 2.0, np.nan, 1)):
        assert_same(library, c_samples.extremes, *arguments)


def test_arrays_are_written_as_in_python(library: CLibrary) -> None:
    assert_same(library, c_samples.in_order, np.array([1.0, 2.0]))
    assert_same(library, c_samples.arrays, MATRIX, np.zeros(4))
    for start in (-1.0, 1.0):
        assert_same(library, c_samples.nothing, np.array([start]))


def test_the_code_has_neither_memory_of_its_own_nor_unknown_names() -> None:
    program = CProgram(c_samples.TABLE)
    program.add(c_samples.arrays, {"matrix": ArrayType.MATRIX, "out": ArrayType.VECTOR})
    code = program.header("sample") + program.source("sample")
    for word in ("malloc", "calloc", "alloca", "static double sample"):
        assert word not in code
    # Docstrings become comments, names stay names.
    assert (
        "/* c_samples.py, arrays: Rows, pieces, lengths and new arrays of two functions. */" in code
    )
    assert "double third_1[4];" in code or "double values_1[4];" in code


REFUSED = [
    value
    for value in vars(c_refused).values()
    if hasattr(value, "py_func") and value.py_func.__doc__
]


@pytest.mark.parametrize("kernel", REFUSED, ids=lambda kernel: kernel.py_func.__name__)
def test_other_code_is_refused_with_file_line_and_remedy(kernel: Any) -> None:
    with pytest.raises(UnsupportedCodeError) as refused:
        CProgram(c_refused.Pair(1.0, 2)).add(kernel, {"values": ArrayType.VECTOR})
    message = str(refused.value)
    assert kernel.py_func.__doc__ in message
    assert Path(c_refused.__file__).name in message
    first = kernel.py_func.__code__.co_firstlineno
    line = int(message.split("line ")[1].split(" ", maxsplit=1)[0])
    assert first <= line <= first + 12
    assert len(message.split(". ")) > 1, "no remedy"
