"""Scenarios and corners: those that ship against their own limits, cones, lengths, other cars."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kinematic_plant import KinematicCar

from rt_controller import cli, simulate
from rt_controller.bus.identity import DISENGAGED_FRAMES
from rt_controller.config import ControllerConfig
from rt_controller.contract.errors import PlantError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import MISSION_PERIOD_TICKS, PERIOD_S
from rt_controller.drive.plan_view import plan_view
from rt_controller.drive.scenario import EXIT_LIMIT, limits_missed
from rt_controller.loop import RELEASE_TICKS, Ending
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.validity import Validity
from sim_bridge import parse_scenario, session
from sim_bridge.scenario import load_scenario, shipped_scenarios

DRIVING = {Mode.STANDBY, Mode.NOMINAL, Mode.LOW_SPEED, Mode.STANDSTILL}
LONGEST_S = 15.0
"""of a scenario that is driven with every change"""


def shipped():
    """All shipped scenarios; those that last longer are left to the slow tests."""
    slow = pytest.mark.nightly
    return [
        pytest.param(name, marks=slow if load_scenario(name).duration_s > LONGEST_S else ())
        for name in shipped_scenarios()
    ]


@pytest.fixture(scope="module")
def lti():
    return load_bundle(shipped_model("lti"))


@pytest.mark.parametrize("name", shipped())
def test_a_shipped_scenario_is_driven_within_its_own_limits(name):
    driven = simulate(name, model="mdk-net")
    assert limits_missed(driven.car_figures) == []
    assert set(driven.modes) <= DRIVING
    assert driven.ending == "the mission is over"


def test_a_scenario_built_in_python_is_driven_and_judged(lti):
    content = {
        "format": 2, "name": "built", "duration_s": 2.0, "reference": {"speed_kmh": 60.0},
        "metrics": ["speed_peak_mps"], "limits": {"ey_peak_m": 0.05},
    }  # fmt: skip
    driven = simulate(parse_scenario(content, "built"), model=lti, plant=KinematicCar())
    assert [figure.name for figure in driven.car_figures] == ["ey_peak_m", "speed_peak_mps"]
    assert driven.car_figures[0].is_kept


def test_slowing_gently_into_a_climb_the_throttle_holds_the_speed():
    content = {
        "format": 2, "name": "uphill", "duration_s": 11.0,
        "road": {"grade_percent": {"s_m": [20.0, 120.0], "value": [-6.0, 10.0]}},
        "reference": {"speed_kmh": {"s_m": [0.0, 150.0, 300.0], "value": [80.0, 65.0, 65.0]}},
    }  # fmt: skip
    driven = simulate(parse_scenario(content, "uphill"), model="mdk-net")
    assert driven.errors.vx_peak_mps < 0.5
    pressed = np.sign(driven["throttle"] - driven["brake_n"])
    assert np.count_nonzero(np.diff(pressed[pressed != 0.0])) <= 2


def test_a_speed_that_the_engine_cannot_reach_is_reported_and_in_the_verdict(
    tmp_path, monkeypatch, capsys
):
    summary, scenario = tmp_path / "drive.json", tmp_path / "steep.toml"
    scenario.write_text(
        'format = 2\nname = "steep"\nduration_s = 7.0\nroad.grade_percent = 20.0\n'
        "reference.speed_kmh = { s_m = [0.0, 100.0], value = [90.0, 130.0] }\n"
    )
    options = "--bus virtual --pace lockstep --quiet --model mdk-net"
    files = ("--json", str(summary), "--scenario", str(scenario))
    monkeypatch.setattr("sys.argv", ["rt-controller", *options.split(), *files])
    with pytest.raises(SystemExit):
        cli.main()
    assert set(json.loads(summary.read_text())["ticks_by_fault"]) == {"SPEED_NOT_FOLLOWED"}
    assert "but not its speed" in capsys.readouterr().out


def test_a_drive_outside_of_the_training_is_named_before_it_and_after_it(
    tmp_path, monkeypatch, capsys, lti
):
    wide = np.full(2, 20.0)
    validity = Validity(np.array([3.0, 40.0]), wide, wide, np.full(2, 0.004), np.zeros((0, 2)))
    replace(lti, validity=validity).save(tmp_path / "known")
    scenario, summary = tmp_path / "bend.toml", tmp_path / "drive.json"
    scenario.write_text(
        'format = 2\nname = "bend"\nduration_s = 4.0\nreference.speed_kmh = 60.0\n'
        "[road.curvature_per_m]\ns_m = [20.0, 30.0, 45.0, 55.0]\nvalue = [0.0, 0.01, 0.01, 0.0]\n"
    )
    options = "--bus virtual --pace lockstep"
    files = (
        "--json",
        str(summary),
        "--scenario",
        str(scenario),
        "--model",
        str(tmp_path / "known"),
    )
    monkeypatch.setattr("sys.argv", ["rt-controller", *options.split(), *files])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    shown, found = capsys.readouterr(), json.loads(summary.read_text())
    assert ended.value.code == 0
    assert "curvature 0.01 1/m at 60 km/h (the model was trained to 0.004)" in shown.err
    assert set(found["ticks_by_fault"]) == {"OUTSIDE_TRAINING"}
    time_s = PERIOD_S * found["ticks_by_fault"]["OUTSIDE_TRAINING"]
    assert 1.0 < time_s < 2.0
    assert f"{time_s:.1f} s outside of what the model was trained with: curvature 0.01" in shown.out
    assert found["outside_training"] == "curvature 0.01 of 0.004 1/m"


def test_a_missed_limit_is_an_exit_code_of_the_program(tmp_path, monkeypatch):
    summary, scenario = tmp_path / "drive.json", tmp_path / "off.toml"
    scenario.write_text(
        'format = 2\nname = "off"\nduration_s = 0.5\ninitial.ey_m = 0.2\n'
        "reference.speed_kmh = 60.0\nlimits.ey_peak_m = 0.1\n"
    )
    options = "--bus virtual --pace lockstep --quiet --model lti"
    files = ("--json", str(summary), "--scenario", str(scenario))
    for stop, code in (((), EXIT_LIMIT), (("--duration-s", "0.2"), 0)):
        monkeypatch.setattr("sys.argv", ["rt-controller", *options.split(), *files, *stop])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == code
        assert json.loads(summary.read_text())["limits_missed"] == ["ey_peak_m"]


def first_driven(driven):
    """Index of the first tick in which the controller drives; before it the vehicle answers."""
    return next(k for k, mode in enumerate(driven.modes) if mode.drives)


def test_place_cones_and_time_at_the_limit_of_the_wheel_are_of_the_drive(lti):
    content = {
        "format": 2, "name": "too tight", "duration_s": 3.0,
        "initial": {"s_m": 50.0, "ey_m": 1.3},  # on the path: the car passes the cone at 1.3 m
        "road": {"curvature_per_m": 0.025},
        "reference": {"speed_kmh": 40.0, "ey_m": {
            "kind": "slalom", "start_s_m": 10.0, "spacing_m": 30.0, "cones": 2}},
    }  # fmt: skip
    driven = simulate(parse_scenario(content, "tight"), model=lti, plant=KinematicCar())
    assert driven["s_m"][0] == 50.0
    first = first_driven(driven)
    stands, moves = slice(None, first + 2), slice(first + 2, -1)
    assert np.all(driven["s_m"][stands] == 50.0)  # until the first command
    moved_m = np.diff(driven["s_m"], prepend=50.0)
    np.testing.assert_allclose(moved_m[moves], driven["ds_m"][moves], atol=2e-4)
    assert driven.at_limit_s.steer_rad > 2.0
    assert driven.at_limit_s.brake_n == 0.0
    cones = plan_view(driven).lines["cone"]
    along_m, radius_m = np.array([5.0, np.nan, 35.0, np.nan]), 40.0  # from the start; gaps
    angle_rad, away_m = (
        np.arctan2(cones.x_m, radius_m - cones.y_m),
        np.hypot(cones.x_m, cones.y_m - radius_m),
    )
    np.testing.assert_allclose(radius_m * angle_rad, along_m, atol=0.05)
    np.testing.assert_allclose(np.abs(away_m - radius_m)[::2], 0.0, atol=1.5)


def test_a_drive_ends_when_the_end_of_its_road_is_confirmed(lti):
    content = {
        "format": 2, "name": "short", "duration_s": 60.0, "reference": {"speed_kmh": 60.0},
        "road": {"length_m": 30.0},
    }  # fmt: skip
    driven = simulate(parse_scenario(content, "short"), model=lti, plant=KinematicCar())
    end_s = 30.0 / (60.0 / 3.6)
    confirmed_s = DISENGAGED_FRAMES * MISSION_PERIOD_TICKS * PERIOD_S
    ended_s = driven["time_s"][-1] - driven["time_s"][first_driven(driven)]
    released_s = (RELEASE_TICKS + 1) * PERIOD_S
    assert end_s < ended_s < end_s + confirmed_s + released_s


def test_a_safe_stop_that_begins_after_the_end_of_the_scenario_brakes_to_rest(lti):
    content = {
        "format": 2, "name": "late", "duration_s": 10.0, "distance_m": 20.0,
        "reference": {"speed_kmh": 42.0},
        "faults": [{"kind": "mission_lost", "start_s": 1.45, "duration_s": 1.5}],
    }  # fmt: skip
    driven = simulate(parse_scenario(content, "late"), model=lti)
    assert np.interp(20.0, driven["s_m"], driven["time_s"]) < 1.9  # the stop begins after it
    assert driven.ending == Ending.SAFE_STOPPED.value
    assert driven.modes[-1] is Mode.SAFE_STOP
    assert abs(driven["vx_mps"][-1]) < 0.3
    assert driven["time_s"][-1] < 15.0


def test_a_car_that_its_brake_cannot_stop_is_an_error(lti, monkeypatch):
    monkeypatch.setattr(session, "LONGEST_STOP_S", 4.0)

    class NoBrake(KinematicCar):
        def step(self, control, dt_s):
            return super().step(control._replace(throttle=0.1, brake_n=0.0), dt_s)

    faults = [{"kind": "state_lost", "start_s": 1.0, "duration_s": 1.0}]
    content = {
        "format": 2, "name": "on", "duration_s": 3.0, "reference": {"speed_kmh": 42.0},
        "faults": faults,
    }  # fmt: skip
    with pytest.raises(PlantError, match="at rest within 4 s"):
        simulate(parse_scenario(content, "on"), model=lti, plant=NoBrake())


CARS = Path(__file__).parents[2] / "sim_bridge" / "cars"
LARGEST_EY_M = 0.3
NOISE = [
    {"kind": "noise", "signals": [signal], "value": value, "seed": seed}
    for seed, (signal, value) in enumerate(
        {
            "vx_mps": 0.02, "vy_mps": 0.02, "yaw_rate_radps": 0.003, "ey_m": 0.01,
            "epsi_rad": 0.001,
        }.items()
    )
]  # fmt: skip
TURN = {"kind": "course", "bends": [
    {"straight_m": 10.0, "radius_m": 8.0, "turn_deg": 180.0}, {"straight_m": 20.0},
]}  # fmt: skip


def u_turn(**changes):
    content = {
        "format": 2, "name": "U-turn", "duration_s": 25.0, "initial": {"speed_kmh": 7.2},
        "road": {"curvature_per_m": TURN}, "reference": {"speed_kmh": 7.2},
    }  # fmt: skip
    return parse_scenario({**content, **changes}, "test")


OWN_CAR = "another ratio and lock"


@pytest.mark.parametrize(
    ("scenario", "car"),
    [
        ("u_turn", "c_class_150kw_awd"),
        ("corner", "c_class_150kw_bev"),
        ("noise", "c_class_150kw_awd"),
        ("u_turn", OWN_CAR),
    ],
)
def test_a_corner_is_driven_near_its_path(scenario, car, tmp_path):
    config = ControllerConfig()
    if car == OWN_CAR:
        text = (CARS / "c_class_150kw_awd.toml").read_text("utf-8")
        own = text.replace("ratio = { value = 18.5", "ratio = { value = 14.0")
        (tmp_path / "own.toml").write_text(own, "utf-8")
        car = str(tmp_path / "own.toml")
        config = ControllerConfig(low_speed={"steering_ratio": 14.0, "lock_rad": 7.5})
    chosen = u_turn(faults=NOISE) if scenario == "noise" else scenario
    driven = simulate(chosen, car=car, config=config)
    assert driven.ending == "the mission is over"
    assert driven.errors.ey_peak_m < LARGEST_EY_M
    assert set(driven.modes) <= {Mode.STANDBY, Mode.LOW_SPEED}
    assert abs(driven["steer_rad"]).max() > 3.0


def test_a_car_stops_and_starts_inside_its_turn():
    stops = [{"at_s_m": 20.0, "hold_s": 2.0}]
    driven = simulate(u_turn(reference={"speed_kmh": 7.2}, initial={"speed_kmh": 0.0}, stops=stops))
    assert {Mode.STANDSTILL, Mode.LOW_SPEED} <= set(driven.modes)
    assert Mode.SAFE_STOP not in driven.modes
    assert driven.errors.ey_peak_m < LARGEST_EY_M


def test_the_model_takes_over_when_the_wheel_is_within_the_bound_of_its_plan():
    course = {"kind": "course", "bends": [
        {"straight_m": 20.0, "radius_m": 20.0, "turn_deg": 90.0}, {"straight_m": 150.0},
    ]}  # fmt: skip
    speed = {"kind": "curve_speed", "max_kmh": 50.0, "lateral_mps2": 2.0}
    content = {"road": {"curvature_per_m": course}, "reference": {"speed_kmh": speed}}
    driven = simulate(u_turn(initial={"speed_kmh": 22.0}, duration_s=15.0, **content))
    is_model = [mode is Mode.NOMINAL for mode in driven.modes]
    assert any(is_model)
    assert driven.ending == "the mission is over"
    assert abs(driven["steer_rad"][is_model]).max() <= INPUT_LIMITS.upper.steer_rad
    assert abs(driven["steer_rad"]).max() > 2.0
