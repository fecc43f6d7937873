"""The law in C plans as the law in Python: recorded drives and random situations."""

import numpy as np
import pytest

from benchmarks.native.parity import compare
from benchmarks.native.situations import random_situations
from offline.targets.recorded_drives import record_drive
from rt_controller.config import ControllerConfig
from rt_controller.model.bundle import Bundle

DOUBLE, FLOAT = 1e-6, 1e-3
"""largest difference from the exact solution, in units of an input's range"""
MODELS = ("mdk-net", "mdk-net-paper", "lti")


def require_parity(found, double=DOUBLE, single=FLOAT):
    for real, largest in (("double", double), ("float", single)):
        figures = found[real].parity(found["exact"])
        assert figures["worst_of_range"] <= largest, (real, figures)
    assert found["double"].parity(found["exact"])["plans_of_one_only"] == 0


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    ("scenario", "plant", "duration_s"),
    [
        ("lane_change_60", "own", 3.0),
        ("road_course", "own", 3.0),
        ("double_lane_change", "commonroad:1", 6.0),  # a steering factor of another car
    ],
)
def test_recorded_plans_are_those_of_the_exact_solution(model, scenario, plant, duration_s):
    bundle, config = Bundle.load(model), ControllerConfig()
    drive = record_drive(bundle, config, scenario, plant=plant, duration_s=duration_s)
    found = compare([drive], bundle)
    for plans in found.values():
        assert len(plans.is_solved) >= 100
        assert plans.is_solved.all()
    require_parity(found)


def test_random_situations_are_planned_alike_in_double():
    bundle = Bundle.load("mdk-net")
    found = compare([random_situations(bundle, 120, seed=5)], bundle)
    require_parity(found, single=np.inf)
    in_float = found["float"].parity(found["exact"])
    assert in_float["plans_of_one_only"] <= 6
    assert in_float["median_of_range"] <= FLOAT


@pytest.mark.nightly
@pytest.mark.parametrize("model", MODELS)
def test_many_random_situations_are_planned_alike_in_double(model):
    bundle = Bundle.load(model)
    require_parity(compare([random_situations(bundle, 2000, seed=6)], bundle), single=np.inf)
