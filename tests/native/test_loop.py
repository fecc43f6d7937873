"""The control law in C in the loop: `--plan native`."""

import numpy as np
import pytest

from rt_controller import simulate
from rt_controller.config import ControllerConfig
from rt_controller.contract.signals import Mode
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_planner
from rt_controller.simulation import car_settings_of, drive_in_lockstep

NATIVE = ControllerConfig(plan="native")
FAULT = '[[faults]]\nkind = "bias"\nsignals = ["ey_m"]\nvalue = 3.0\nstart_s = 6.0\n'


@pytest.mark.parametrize(
    ("model", "scenario", "stop_cause"),
    [
        ("mdk-net", "double_lane_change", "NONE"),
        ("mdk-net", "stop_and_hold", "NONE"),
        ("mdk-net", "road_course", "LATERAL_ERROR_IMPLAUSIBLE"),
        pytest.param("lti", "double_lane_change", "NONE", marks=pytest.mark.nightly),
    ],
)
def test_the_law_in_c_drives_and_stops_as_the_law_in_python(model, scenario, stop_cause, tmp_path):
    faults = tmp_path / "faults.toml"
    faults.write_text(FAULT)
    chosen = None if stop_cause == "NONE" else faults
    python, native = (
        simulate(scenario, model=model, config=each, faults=chosen) for each in (None, NATIVE)
    )
    assert len(python) == len(native)
    assert native.stop_cause == stop_cause
    assert np.abs(native.true_poses - python.true_poses)[:, 1].max() <= 2e-4  # lateral, m
    assert native.model.endswith("in C")


def test_a_first_input_that_piqp_does_not_confirm_stops_the_car():
    bundle = Bundle.load("mdk-net")
    planner = build_planner(bundle, NATIVE)
    planner.qp["v"] = planner.qp["v"] + 0.01  # a copy, which the solver does not write
    drive = drive_in_lockstep(NATIVE, bundle, planner, car_settings_of())
    assert drive.stop_cause == "SOLVER_FAILED"
    assert drive.modes[-1] is Mode.SAFE_STOP
    assert drive["vx_mps"][0] > 20.0
    assert drive["vx_mps"][-1] < 0.5
