"""The law in C plans as the law in Python: recorded drives and random situations."""

import numpy as np
import pytest

from benchmarks.native.parity import compare
from benchmarks.native.recorded import record_drive
from benchmarks.native.situations import random_calls
from rt_controller.model.bundle import Bundle
from sim_bridge.scenario import load_scenario

DOUBLE, FLOAT = 1e-6, 1e-3
"""largest difference from the exact solution, in units of an input's range"""
MODELS = ("mdk-net", "mdk-net-paper", "lti")


def require_parity(found, double=DOUBLE, single=FLOAT):
    for real, largest in (("double", double), ("float", single)):
        figures = found.parity("exact", real)
        assert figures["worst_of_range"] <= largest, (real, figures)
    assert found.parity("exact", "double")["plans_of_one_only"] == 0


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("scenario", ["lane_change_60", "road_course"])
def test_recorded_plans_are_those_of_the_exact_solution(model, scenario):
    bundle = Bundle.load(model)
    found = compare([record_drive(bundle, load_scenario(scenario), "own", 3.0)], bundle)
    assert len(found.solved) >= 100
    assert found.solved.all()
    require_parity(found)


def test_a_stop_and_a_new_start_are_planned_alike():
    bundle = Bundle.load("mdk-net")
    found = compare([record_drive(bundle, load_scenario("stop_and_go"), "own", 8.0)], bundle)
    require_parity(found)


def test_random_situations_are_planned_alike_in_double():
    bundle = Bundle.load("mdk-net")
    found = compare([list(random_calls(bundle, 120, seed=5))], bundle)
    require_parity(found, single=np.inf)
    in_float = found.parity("exact", "float")
    assert in_float["plans_of_one_only"] <= 6
    assert in_float["median_of_range"] <= FLOAT


@pytest.mark.nightly
@pytest.mark.parametrize("model", MODELS)
def test_many_random_situations_are_planned_alike_in_double(model):
    bundle = Bundle.load(model)
    require_parity(compare([list(random_calls(bundle, 2000, seed=6))], bundle), single=np.inf)
