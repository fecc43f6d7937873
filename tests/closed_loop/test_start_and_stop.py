"""The shipped models start, stop at a target, hold and drive on; a safe stop always ends."""

from math import degrees

import numpy as np
import pytest

from rt_controller import Drive, simulate
from rt_controller.contract.signals import Mode
from sim_bridge import Scenario, parse_scenario

SLOW = [Mode.LOW_SPEED, Mode.STANDSTILL, Mode.LOW_SPEED]
"""of a stop and a start"""


def stop_and_go(
    braking_mps2: float,
    friction: float = 0.85,
    curvature: float = 0.0,
    cruise_kmh: float = 18.0,
    hold_s: float = 2.0,
) -> Scenario:
    cruise_mps = cruise_kmh / 3.6
    stop = {
        "at_s_m": 1.2 * cruise_mps + cruise_mps**2 / 2.0 / braking_mps2,
        "hold_s": hold_s,
        "deceleration_mps2": braking_mps2,
        "acceleration_mps2": 1.5,
    }
    return parse_scenario(
        {
            "format": 2,
            "name": "stop and go",
            "duration_s": cruise_mps / braking_mps2 + cruise_mps / 1.5 + hold_s + 3.0,
            "road": {"friction": friction, "curvature_per_m": curvature},
            "reference": {"speed_kmh": cruise_kmh},
            "stops": [stop],
            "metrics": ["stop_error_m", "creep_m", "hold_steer_rad"],
        },
        "a test",
    )


def laws(drive: Drive) -> list[Mode]:
    """The modes in their order, repetitions left out."""
    modes = [mode for mode in drive.modes if mode is not Mode.STANDBY]
    return [mode for k, mode in enumerate(modes) if k == 0 or mode is not modes[k - 1]]


def pedal_changes(drive: Drive, after_s: float) -> int:
    """From throttle to brake and back."""
    pressed = np.sign(drive["throttle"] - drive["brake_n"])
    pressed = pressed[(pressed != 0.0) & (drive["time_s"] >= after_s)]
    return int(np.count_nonzero(np.diff(pressed)))


@pytest.mark.parametrize(
    ("model", "braking_mps2", "friction", "curvature"),
    [("mdk-net", 2.5, 0.85, 0.0), ("lti", 1.0, 0.85, 0.005), ("mdk-net", 1.5, 0.3, -0.005)],
)
def test_a_stop_is_at_its_target_held_and_left(
    model: str, braking_mps2: float, friction: float, curvature: float
) -> None:
    drive = simulate(stop_and_go(braking_mps2, friction, curvature), model=model)
    found = {figure.name: figure.value for figure in drive.car_figures}
    assert found["stop_error_m"] < 0.1
    assert found["creep_m"] < 0.02
    assert found["hold_steer_rad"] == 0.0
    assert laws(drive) == SLOW
    assert np.abs(drive["vx_mps"] - drive["path_vx_mps"])[drive["vx_mps"] > 4.0].max() < 1.0


def test_a_car_stops_from_60_km_per_h_is_held_for_ten_seconds_and_drives_on() -> None:
    drive = simulate(stop_and_go(1.8, cruise_kmh=60.0, hold_s=10.0), model="mdk-net")
    found = {figure.name: figure.value for figure in drive.car_figures}
    assert found["stop_error_m"] < 0.2
    assert found["creep_m"] < 0.02
    assert degrees(found["hold_steer_rad"]) < 1.0
    assert laws(drive) == [Mode.NOMINAL, *SLOW, Mode.NOMINAL]
    assert drive["vx_mps"][-1] > 14.0
    assert drive.errors.ey_peak_m < 0.1


@pytest.mark.parametrize(
    ("model", "speed_kmh"),
    [("mdk-net", 18.0), ("mdk-net", 32.0), ("mdk-net-paper", 36.0), ("lti", 25.0)],
)
def test_a_constant_speed_near_the_handover_needs_no_change_of_the_pedal(
    model: str, speed_kmh: float
) -> None:
    scenario = parse_scenario(
        {"format": 2, "name": "constant", "duration_s": 8.0, "reference": {"speed_kmh": speed_kmh}},
        "a test",
    )
    drive = simulate(scenario, model=model)
    assert pedal_changes(drive, after_s=2.0) == 0
    assert drive.errors.vx_peak_mps < 0.4


def test_a_car_that_stands_at_the_start_drives_off() -> None:
    speed = {"t_s": [0.0, 1.0, 9.0], "value": [0.0, 0.0, 45.0]}
    scenario = parse_scenario(
        {"format": 2, "name": "start", "duration_s": 9.0, "reference": {"speed_kmh": speed}},
        "a test",
    )
    drive = simulate(scenario)
    assert laws(drive) == [Mode.STANDSTILL, Mode.LOW_SPEED, Mode.NOMINAL]
    assert drive.errors.vx_peak_mps < 0.6  # the delay of two periods alone makes 0.08
    assert drive.errors.ey_peak_m < 0.02


@pytest.mark.parametrize("duration_s", [4.9])
def test_a_requested_stop_ends_also_when_the_mission_ends_meanwhile(duration_s: float) -> None:
    drive = simulate("straight", model="lti", duration_s=duration_s)
    assert drive.ending == "stopped on request"
    assert drive.modes[-1] is Mode.SAFE_STOP
    assert abs(drive["vx_mps"][-1]) < 0.3
    assert drive["time_s"][-1] < duration_s + 6.0
