"""Starts, stops, sudden bends, and faults from the first tick on."""

from contextlib import closing
from dataclasses import replace
from math import degrees

import numpy as np
import pytest

from rt_controller import simulate
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import NEUTRAL_INPUT, Mode
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.loop import Ending
from rt_controller.settings import BusSettings
from sim_bridge import parse_scenario
from sim_bridge.faults.fault import SHORTHANDS, Fault
from sim_bridge.session import open_session

SLOW = [Mode.LOW_SPEED, Mode.STANDSTILL, Mode.LOW_SPEED]
"""of a stop and a start"""


CURVATURE_STEP = {"s_m": [0.0, 30.0], "value": [0.0, 0.003], "interpolation": "step"}


def stop_and_go(braking_mps2, friction=0.85, curvature=0.0, cruise_kmh=18.0, hold_s=2.0):
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


def laws(drive):
    """The modes in their order, repetitions left out."""
    modes = [mode for mode in drive.modes if mode is not Mode.STANDBY]
    return [mode for k, mode in enumerate(modes) if k == 0 or mode is not modes[k - 1]]


def pedal_changes(drive, after_s):
    """From throttle to brake and back."""
    pressed = np.sign(drive["throttle"] - drive["brake_n"])
    pressed = pressed[(pressed != 0.0) & (drive["time_s"] >= after_s)]
    return int(np.count_nonzero(np.diff(pressed)))


@pytest.mark.parametrize(
    ("model", "braking_mps2", "friction", "curvature"),
    [("mdk-net", 2.5, 0.85, 0.0), ("lti", 1.0, 0.85, 0.005), ("mdk-net", 1.5, 0.3, -0.005)],
)
def test_a_stop_is_at_its_target_held_and_left(model, braking_mps2, friction, curvature):
    drive = simulate(stop_and_go(braking_mps2, friction, curvature), model=model)
    found = {figure.name: figure.value for figure in drive.car_figures}
    assert found["stop_error_m"] < 0.1
    assert found["creep_m"] < 0.02
    assert degrees(found["hold_steer_rad"]) < 1.0
    assert laws(drive) == SLOW
    assert np.abs(drive["vx_mps"] - drive["path_vx_mps"])[drive["vx_mps"] > 4.0].max() < 1.0


def test_a_car_stops_from_60_km_per_h_is_held_for_ten_seconds_and_drives_on():
    drive = simulate(stop_and_go(1.8, cruise_kmh=60.0, hold_s=10.0), model="mdk-net")
    found = {figure.name: figure.value for figure in drive.car_figures}
    assert found["stop_error_m"] < 0.2
    assert found["creep_m"] < 0.02
    assert degrees(found["hold_steer_rad"]) < 1.0
    assert laws(drive) == [Mode.NOMINAL, *SLOW, Mode.NOMINAL]
    assert drive["vx_mps"][-1] > 14.0
    assert drive.errors.ey_peak_m < 0.1


@pytest.mark.parametrize(
    ("model", "speed_kmh"), [("mdk-net", 18.0), ("mdk-net-paper", 36.0), ("lti", 25.0)]
)
def test_a_constant_speed_near_the_handover_needs_no_change_of_the_pedal(model, speed_kmh):
    scenario = parse_scenario(
        {"format": 2, "name": "constant", "duration_s": 8.0, "reference": {"speed_kmh": speed_kmh}},
        "a test",
    )
    drive = simulate(scenario, model=model)
    assert pedal_changes(drive, after_s=2.0) == 0
    assert drive.errors.vx_peak_mps < 0.4


def test_a_car_that_stands_at_the_start_drives_off():
    speed = {"t_s": [0.0, 1.0, 9.0], "value": [0.0, 0.0, 45.0]}
    scenario = parse_scenario(
        {"format": 2, "name": "start", "duration_s": 9.0, "reference": {"speed_kmh": speed}},
        "a test",
    )
    drive = simulate(scenario)
    assert laws(drive) == [Mode.STANDSTILL, Mode.LOW_SPEED, Mode.NOMINAL]
    assert drive.errors.vx_peak_mps < 0.6  # the delay of two periods alone makes 0.08
    assert drive.errors.ey_peak_m < 0.02


def test_a_requested_stop_ends_also_when_the_mission_ends_meanwhile():
    drive = simulate("straight", model="lti", duration_s=4.9)
    assert drive.ending == "stopped on request"
    assert drive.modes[-1] is Mode.SAFE_STOP
    assert abs(drive["vx_mps"][-1]) < 0.3
    assert drive["time_s"][-1] < 10.9


def bend():
    content = {
        "format": 2,
        "name": "sudden bend",
        "duration_s": 3.0,
        "road": {"curvature_per_m": CURVATURE_STEP},
        "reference": {"speed_kmh": 80.0},
    }
    return parse_scenario(content, "test")


@pytest.fixture(scope="module", params=["lti", "mdk-net"])
def drives(request):
    """With the curvature ahead, and without."""
    lost = Fault(kind="preview_lost")
    scenarios = (bend(), replace(bend(), faults=(lost,)))
    with_preview, without = (simulate(each, model=request.param) for each in scenarios)
    return with_preview, without


def wheel_rad(drive, time_s):
    """Change of the steering wheel angle from one second before the step to this time after it."""
    step_s = drive["time_s"][np.argmax(drive["curvature_per_m"] > 1e-3)]
    at = np.interp([step_s - 1.0, step_s + time_s], drive["time_s"], drive["steer_rad"])
    return float(at[1] - at[0])


def test_the_wheel_turns_before_the_bend(drives):
    with_preview, without = drives
    assert wheel_rad(with_preview, -0.05) > 0.05
    assert abs(wheel_rad(without, -0.05)) < 0.01


def test_the_errors_in_a_sudden_bend_are_smaller(drives):
    with_preview, without = drives
    for drive in drives:
        assert set(drive.modes) <= {Mode.STANDBY, Mode.NOMINAL}
    assert with_preview.errors.epsi_peak_rad < without.errors.epsi_peak_rad
    assert with_preview.errors.ey_peak_m < without.errors.ey_peak_m
    changes = [np.square(np.diff(drive["steer_rad"])).mean() for drive in drives]
    assert changes[0] < changes[1]


PARTS = {
    "state_offset": {"signal": "ey_m", "value": 0.1},
    "state_noise": {"signal": "ey_m", "value": 0.1},
    "state_delayed": {"delay_s": 0.05},
}
SPEED_KMH = 40.0
"""above that of the low-speed law, so the mode of a normal drive is NOMINAL"""
SAFE_STOPS = {"state_lost", "state_invalid", "reference_lost", "command_lost"}


@pytest.mark.parametrize("kind", list(SHORTHANDS))
def test_a_drive_with_a_fault_from_its_first_tick_ends(kind):
    fault = {"kind": kind, "start_s": 0.0, "duration_s": 0.2, **PARTS.get(kind, {})}
    content = {
        "format": 2, "name": "x", "duration_s": 1.5, "reference": {"speed_kmh": SPEED_KMH},
        "faults": [fault],
    }  # fmt: skip
    drive = simulate(parse_scenario(content, "test"), model="lti")
    expected = Ending.SAFE_STOPPED if kind in SAFE_STOPS else Ending.MISSION_OVER
    assert drive.ending == expected.value
    assert Mode.NOMINAL in drive.modes


def test_simulated_time_does_not_wait_without_end_for_a_controller():
    bus = BusSettings(bus="virtual", channel="no-controller")
    with closing(open_session(bus, "straight")) as session:
        session.tick(PERIOD_NS)
        with pytest.raises(BusError, match="stays in STANDBY"):
            session.tick(11_000_000_000)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("radius_m", "speed_kmh", "road", "car"),
    [
        (12.0, 20.0, {}, None),
        (100.0, 60.0, {"grade_percent": 8.0}, None),
        (100.0, 60.0, {"bank_deg": -3.4}, "c_class_125kw_fwd"),
        (1000.0, 100.0, {}, "c_class_150kw_bev"),
    ],
)
def test_a_drive_that_begins_in_a_bend_begins_in_its_steady_turn(
    radius_m, speed_kmh, road, car, side
):
    content = {
        "format": 2,
        "name": "in a bend",
        "duration_s": 5.0,
        "road": {"curvature_per_m": side / radius_m, **road},
        "reference": {"speed_kmh": speed_kmh},
    }
    drive = simulate(parse_scenario(content, "a test"), car=car)
    first = int(np.argmax([mode.drives for mode in drive.modes]))
    turn_radps = side * drive["vx_mps"][first] / radius_m
    assert drive["yaw_rate_radps"][first] == pytest.approx(turn_radps, rel=0.02)
    assert side * drive["steer_rad"][first] > 0.0
    assert speed_kmh < 30.0 or drive["throttle"][first] > 0.0  # idling, the engine pulls
    assert drive.stop_s is None
    assert drive.errors.ey_peak_m < 0.05
    assert np.abs(drive["path_vx_mps"] - drive["vx_mps"])[first : first + 80].max() < 0.35


def test_a_car_without_the_grip_of_its_first_bend_begins_straight_ahead():
    content = {
        "format": 2,
        "name": "too fast",
        "duration_s": 1.0,
        "road": {"curvature_per_m": 0.02, "friction": 0.85},
        "reference": {"speed_kmh": 70.0},
    }
    scenario = parse_scenario(content, "a test").with_friction(0.3)
    with closing(open_session(BusSettings(bus="virtual", channel="too fast"), scenario)) as session:
        assert session.bridge.applied == NEUTRAL_INPUT


@pytest.mark.parametrize("kind", ["reference_lost", "command_lost"])
@pytest.mark.parametrize(
    ("radius_m", "speed_kmh", "grade_percent", "friction"),
    [(60.0, 55.0, -20.0, 1.0), (60.0, 55.0, 0.0, 0.6), (-20.0, 36.0, 0.0, 1.0)],
)
def test_a_stop_keeps_to_a_tight_bend_and_ends_on_a_descent_too(
    kind, radius_m, speed_kmh, grade_percent, friction
):
    content = {
        "format": 2,
        "name": "a stop in a bend",
        "duration_s": 2.0,
        "road": {
            "curvature_per_m": 1.0 / radius_m,
            "grade_percent": grade_percent,
            "friction": friction,
        },
        "reference": {"speed_kmh": speed_kmh},
        "faults": [{"kind": kind, "start_s": 1.0, "duration_s": 60.0}],
    }
    drive = simulate(parse_scenario(content, "a test"))
    assert abs(drive["vx_mps"][-1]) < 0.3
    assert drive.errors.ey_peak_m < 0.1


@pytest.mark.parametrize(
    ("road", "speed_kmh", "epsi_deg", "most_m"),
    [
        ({"curvature_per_m": 1.0 / 250.0}, 80.0, 0.0, 0.005),
        ({"curvature_per_m": -1.0 / 40.0}, 45.0, 1.0, 0.06),
        ({"bank_deg": 4.0}, 80.0, 0.0, 0.006),
        ({"bank_deg": 4.0}, 80.0, 1.0, 0.09),  # 0.075 m without a bank
    ],
)
def test_a_takeover_knows_bank_and_turn_but_takes_no_heading_error_for_them(
    road, speed_kmh, epsi_deg, most_m
):
    content = {
        "format": 2,
        "name": "a takeover",
        "duration_s": 4.0,
        "road": road,
        "reference": {"speed_kmh": speed_kmh},
        "initial": {"epsi_deg": epsi_deg},
    }
    assert simulate(parse_scenario(content, "a test")).errors.ey_peak_m < most_m


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_controller_asks_for_no_wheel_angle_that_the_vehicle_refuses(side):
    """At 125 km/h 40 deg mean more lateral acceleration than the vehicle accepts."""
    curvature = {"s_m": [60.0, 100.0], "value": [0.0, side * 0.0033]}
    content = {
        "format": 2,
        "name": "fast and wet",
        "duration_s": 8.0,
        "road": {"friction": 0.5, "curvature_per_m": curvature},
        "reference": {"speed_kmh": 125.0},
    }
    drive = simulate(parse_scenario(content, "a test"))
    assert drive.stop_s is None
    assert drive.errors.ey_peak_m < 0.5
