"""A sudden bend: with the curvature ahead the wheel turns before the car is in it."""

from dataclasses import replace

import numpy as np
import pytest

from rt_controller import Drive, simulate
from rt_controller.contract.signals import Mode
from sim_bridge.faults.fault import Fault
from sim_bridge.scenario import Scenario, parse_scenario


def bend() -> Scenario:
    content = {
        "format": 2,
        "name": "sudden bend",
        "duration_s": 3.0,
        "road": {"curvature_per_m": {"kind": "step", "at_s_m": 30.0, "to_per_m": 0.003}},
        "reference": {"speed_kmh": 80.0},
    }
    return parse_scenario(content, "test")


@pytest.fixture(scope="module", params=["lti", "mdk-net"])
def drives(request: pytest.FixtureRequest) -> tuple[Drive, Drive]:
    """With the curvature ahead, and without."""
    lost = Fault(kind="preview_lost")
    scenarios = (bend(), replace(bend(), faults=(lost,)))
    with_preview, without = (simulate(each, model=request.param) for each in scenarios)
    return with_preview, without


def wheel_rad(drive: Drive, time_s: float) -> float:
    """Change of the steering wheel angle from one second before the step to this time after it."""
    step_s = drive["time_s"][np.argmax(drive["curvature_per_m"] > 1e-3)]
    at = np.interp([step_s - 1.0, step_s + time_s], drive["time_s"], drive["steer_rad"])
    return float(at[1] - at[0])


def test_the_wheel_turns_before_the_bend(drives: tuple[Drive, Drive]) -> None:
    with_preview, without = drives
    assert wheel_rad(with_preview, -0.05) > 0.05
    assert abs(wheel_rad(without, -0.05)) < 0.01


def test_the_errors_in_a_sudden_bend_are_smaller(drives: tuple[Drive, Drive]) -> None:
    with_preview, without = drives
    for drive in drives:
        assert set(drive.modes) <= {Mode.STANDBY, Mode.NOMINAL}
    assert with_preview.errors.epsi_peak_rad < without.errors.epsi_peak_rad
    assert with_preview.errors.ey_peak_m < without.errors.ey_peak_m
    changes = [np.square(np.diff(drive["steer_rad"])).mean() for drive in drives]
    assert changes[0] < changes[1]
