"""The law in C with numbers at and beyond their ranges, and how it goes on afterwards."""

from ctypes import c_double, c_float
from math import inf, nan

import numpy as np
import pytest

from benchmarks.native.parity import c_planner
from benchmarks.native.situations import random_calls
from rt_controller.contract.signals import N_INPUTS
from rt_controller.control.program import SolveStatus
from rt_controller.model.bundle import Bundle

SPECIAL = (nan, inf, -inf, 1e30, -1e30, 1e-310, 0.0, -1.0, 1e-9, 1e6)


@pytest.fixture(scope="module")
def bundle():
    return Bundle.load("mdk-net-paper")


def changed(rng, numbers):
    """A named tuple with a number that is scaled or replaced."""
    place = rng.integers(len(numbers))
    value = rng.choice(SPECIAL) if rng.random() < 0.5 else 4.0 * numbers[place] * rng.normal()
    return type(numbers)(*(*numbers[:place], float(value), *numbers[place + 1 :]))


def fuzzed(rng, arguments):
    """Arguments of `observe` or `plan`, of which one number in two calls is changed."""
    places = [i for i, each in enumerate(arguments) if hasattr(each, "_fields")]
    found = list(arguments)
    if rng.random() < 0.5:
        i = rng.choice(places)
        found[i] = changed(rng, found[i])
    return found


def planned(planner, calls, rng=None):
    """Status of each plan, its arguments, and its inputs."""
    x_0 = None
    for name, arguments in calls:
        now = fuzzed(rng, arguments) if rng and name in ("observe", "plan") else list(arguments)
        if name == "observe":
            x_0 = planner.observer.observe(*now)
        elif name == "plan":
            now[0] = x_0
            yield planner.plan(*now), now, planner.inputs.copy()
        else:
            getattr(planner, name)(*now)


@pytest.mark.parametrize("real", [c_double, c_float])
@pytest.mark.parametrize("count", [1000, pytest.param(20_000, marks=pytest.mark.nightly)])
def test_plans_stay_finite_and_the_last_one_is_held(bundle, real, count):
    planner, rng = c_planner(bundle, real), np.random.default_rng(1)
    solved, last = 0, planner.inputs.copy()
    for status, now, inputs in planned(planner, random_calls(bundle, count, 2), rng):
        assert planner.iterations <= planner.max_iterations
        assert np.isfinite(inputs).all()
        if status is SolveStatus.SOLVED:
            solved += 1
            read = (now[0], (now[1],), now[2], now[3])
            assert not any(np.isnan(each).any() for each in read)
        else:
            assert np.array_equal(inputs, last)
        last = inputs
    assert 0.5 * count < solved < count


@pytest.mark.parametrize("real", [c_double, c_float])
def test_nothing_of_senseless_numbers_stays_after_a_reset(bundle, real):
    used, new = c_planner(bundle, real), c_planner(bundle, real)
    list(planned(used, random_calls(bundle, 100, 3), np.random.default_rng(4)))
    calls = list(random_calls(bundle, 20, 5))
    for one, other in zip(planned(used, calls), planned(new, calls), strict=True):
        assert one[0] is other[0]
        assert one[2] == pytest.approx(other[2], abs=1e-6 if real is c_double else 0.1)


@pytest.mark.parametrize("value", [nan, inf])
@pytest.mark.parametrize("place", range(N_INPUTS))
def test_a_previous_input_that_is_no_number_gives_no_plan(bundle, value, place):
    planner = c_planner(bundle)
    for call in random_calls(bundle, 2, 6):
        if call.name == "observe":
            x_0 = planner.observer.observe(*call.arguments)
        elif call.name == "plan":
            _, kappa, path, previous, *rest = call.arguments
            previous = previous._replace(**{previous._fields[place]: value})
            assert planner.plan(x_0, kappa, path, previous, *rest) is not SolveStatus.SOLVED
