"""The law in C with numbers at and beyond their ranges, and how it goes on afterwards."""

from ctypes import c_double, c_float
from math import inf, nan

import numpy as np
import pytest

from benchmarks.native.parity import c_planner
from benchmarks.native.situations import random_situations
from offline.targets.recorded_drives import plan
from rt_controller.contract.signals import ControlInput
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


def fuzzed(rng, situations):
    """The situations; in half of them one number is changed."""
    for now in situations:
        places = [name for name, each in now._asdict().items() if hasattr(each, "_fields")]
        name = rng.choice(places)
        other = {name: changed(rng, getattr(now, name))} if rng.random() < 0.5 else {}
        yield now._replace(**other)


@pytest.mark.parametrize("real", [c_double, c_float])
@pytest.mark.parametrize("count", [1000, pytest.param(20_000, marks=pytest.mark.nightly)])
def test_plans_stay_finite_and_the_last_one_is_held(bundle, real, count):
    planner, rng = c_planner(bundle, real), np.random.default_rng(1)
    solved, last = 0, planner.inputs.copy()
    for now in fuzzed(rng, random_situations(bundle, count, 2)):
        planned = plan(planner, now)
        assert planned.iterations <= planner.max_iterations
        assert np.isfinite(planned.inputs).all()
        if planned.status is SolveStatus.SOLVED:
            solved += 1
            read = (now.state[:3], now.state[4:], (now.curvature_per_m,), now.path, now.previous)
            assert not any(np.isnan(each).any() for each in read)
        else:
            assert np.array_equal(planned.inputs, last)
        last = planned.inputs
    assert 0.5 * count < solved < count


@pytest.mark.parametrize("real", [c_double, c_float])
def test_nothing_of_senseless_numbers_stays_after_a_reset(bundle, real):
    used, new = c_planner(bundle, real), c_planner(bundle, real)
    for now in fuzzed(np.random.default_rng(4), random_situations(bundle, 100, 3)):
        plan(used, now)
    for now in random_situations(bundle, 20, 5):
        one, other = plan(used, now), plan(new, now)
        assert one.status is other.status
        assert one.inputs == pytest.approx(other.inputs, abs=1e-6 if real is c_double else 0.1)


@pytest.mark.parametrize("value", [nan, inf])
@pytest.mark.parametrize("name", ControlInput._fields)
def test_a_previous_input_that_is_no_number_gives_no_plan(bundle, value, name):
    planner = c_planner(bundle)
    for now in random_situations(bundle, 2, 6):
        previous = now.previous._replace(**{name: value})
        assert plan(planner, now._replace(previous=previous)).status is not SolveStatus.SOLVED
