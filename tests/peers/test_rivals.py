"""The fitted bicycle predicts a drive, and each rival follows a path with it."""

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("casadi", reason="the extra [peers] is not installed")

from benchmarks import tuning
from benchmarks.figures.closed_loop import RIVALS, ROWS, scenario_of
from benchmarks.rivals.bicycle import Bicycle
from benchmarks.rivals.drive import build_rival, drive_with, tuned_values
from benchmarks.rivals.scenarios import FIT, SEARCH
from rt_controller.contract.signals import ControlInput, PathReference, VehicleState
from rt_controller.control.program import SolveStatus
from rt_controller.terminal.command_line import run_command

STATE = VehicleState(22.0, -0.05, 0.06, 0.55, 0.2, 0.02)
PATH = PathReference(0.0, 0.0, 0.0, 0.0, 22.0, 0.0)
PREVIOUS = ControlInput(0.15, 0.0, 0.0)


def test_the_derivatives_of_the_bicycle_are_those_of_its_prediction():
    bicycle, rng = Bicycle(4), np.random.default_rng(0)
    inputs = np.array([0.2, 10.0, 0.3]) * rng.uniform(0.5, 1.0, (4, 3))
    states = bicycle.predict(np.array(STATE), inputs, 0.002)
    found = bicycle.derivatives(states[:-1], inputs, 0.002)
    for column, change in ((0, 1e-4), (1, 1e-5), (2, 1e-5), (4, 1e-4), (5, 1e-5)):
        moved = states[:-1].copy()
        moved[:, column] += change
        after = bicycle.step(moved, inputs, np.full((4, 1), 0.002))
        np.testing.assert_allclose((after - states[1:]) / change, found[:, :, column], atol=1e-3)


@pytest.mark.parametrize("name", RIVALS)
def test_a_rival_steers_back_to_its_path_within_its_limits(name):
    rival = build_rival(name, tuned_values(name))
    for _ in range(3):
        rival.observe(STATE, PREVIOUS)
        assert rival.plan(STATE, 0.0, PATH, PREVIOUS, None, (PREVIOUS,) * 2) is SolveStatus.SOLVED
        rival.prepare()
        rival.warm_up()
    throttle, brake_n, steer_rad = rival.inputs[0]
    assert steer_rad < 0.0
    assert 0.0 <= throttle <= 1.0
    assert brake_n == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", ["bicycle-mpc", "stanley"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_rival_drives_a_bend_beyond_the_usual_wheel_to_its_end(name, side):
    bend = scenario_of(next(row for row in ROWS if f"20 m to the {side}" in row.name))
    drive = drive_with(build_rival(name, tuned_values(name)), replace(bend, duration_s=8.0))
    assert drive.stop_s is None
    assert drive.errors.ey_peak_m < 0.1
    assert np.degrees(np.abs(drive["steer_rad"])).max() > 100.0


def test_a_search_stores_the_best_values_and_never_a_worse_one_than_the_defaults(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(tuning, "SEARCH", (replace(SEARCH[0], duration_s=0.5),))
    file = tmp_path / "found.json"
    with pytest.raises(SystemExit) as ended:
        run_command(tuning.app, ("--controller", "stanley", "--trials", "2", "--json", str(file)))
    assert ended.value.code == 0
    found = json.loads(file.read_text())
    assert found["cost"] <= found["cost_of_defaults"]
    assert found["values"].keys() == tuned_values("stanley").keys()
    assert not {each.name for each in FIT} & {each.name for each in SEARCH}
