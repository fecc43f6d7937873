"""Which relations of the signals of a car are contradicted, in `signals check` and the import."""

from functools import cache

import numpy as np
import pytest

from rt_controller.contract.limits import DEFAULT_GEOMETRY, UNDERSTEER_RAD_PER_MPS2
from rt_controller.mapping.relations import check_relations, relations_of

SPEED_MPS, STEP_S, TICKS = 20.0, 0.025, 800
TIME_S = STEP_S * np.arange(TICKS)
VY = "states.vy_mps"
NOISE = {
    "states.vx_mps": 0.1,
    "states.vy_mps": 0.03,
    "states.yaw_rate_radps": 0.005,
    "states.ey_m": 0.03,
    "states.epsi_rad": 0.003,
    "exogenous.curvature_per_m": 1e-4,
    "inputs.steer_rad": 0.01,
}


@cache
def slalom_drive(turn=1.0):
    """A slalom on a straight road, then a curve of it: columns by slot, every 25 ms."""
    curvature = np.where(TIME_S < 10.0, 0.0, 0.007 * turn)
    slalom = 0.12 * turn * np.cos(0.8 * np.pi * TIME_S) * (TIME_S < 10.0)
    yaw_rate = slalom + curvature * SPEED_MPS
    epsi = STEP_S * np.cumsum(slalom)
    vy = np.where(TIME_S < 10.0, -1.5 * yaw_rate, 0.0)
    wheel = DEFAULT_GEOMETRY.steering_ratio * yaw_rate / SPEED_MPS
    wheel *= DEFAULT_GEOMETRY.wheelbase_m + UNDERSTEER_RAD_PER_MPS2 * SPEED_MPS**2
    constant = np.ones(TICKS)
    return {
        "states.vx_mps": SPEED_MPS * constant,
        "states.vy_mps": vy,
        "states.yaw_rate_radps": yaw_rate,
        "states.ey_m": STEP_S * np.cumsum(SPEED_MPS * np.sin(epsi) + vy * np.cos(epsi)),
        "states.epsi_rad": epsi,
        "exogenous.curvature_per_m": curvature,
        "inputs.steer_rad": wheel,
        "commands.steer_rad": wheel,
        "reference.v_mps": SPEED_MPS * constant,
        "mission.engage": constant,
    }


def answers_of(columns, factors=(), noise=1.0):
    """The answer to each relation, of columns times factors, with noise."""
    rng, scale = np.random.default_rng(0), dict(factors)
    tracks = {}
    for name, values in columns.items():
        measured = values + noise * NOISE.get(name, 0.0) * rng.normal(size=TICKS)
        known = np.column_stack((TIME_S, scale.get(name, 1.0) * measured))
        tracks[name] = known[np.isfinite(measured)]
    found = check_relations(tracks, relations_of(None))
    return {text: each.answer for text, each in found.items()}


def contradicted(*arguments, **options):
    """Texts of the contradicted relations."""
    found = answers_of(*arguments, **options)
    return [text for text, answer in found.items() if answer.startswith("yes")]


def with_columns(**columns):
    """The slalom_drive with other columns, by the last part of their slots."""
    names = {name.partition(".")[2]: name for name in slalom_drive()}
    return {**slalom_drive(), **{names[key]: value for key, value in columns.items()}}


@pytest.mark.parametrize("noise", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("absent", [None, VY, "commands.steer_rad"])
def test_a_right_mapping_has_no_contradiction(noise, absent):
    columns = {name: values for name, values in slalom_drive().items() if name != absent}
    assert set(answers_of(columns, noise=noise).values()) == {"no"}


@pytest.mark.parametrize(
    ("signal", "factor", "broken"),
    [
        ("states.yaw_rate_radps", -1.0, "slope of epsi_rad"),
        ("states.yaw_rate_radps", 0.01745, "slope of epsi_rad"),
        ("states.yaw_rate_radps", 57.3, "v_x * yaw rate"),
        ("states.ey_m", -1.0, "slope of ey_m"),
        ("states.ey_m", 0.1, "slope of ey_m"),
        ("states.ey_m", 100.0, "slope of ey_m"),
        ("states.epsi_rad", -1.0, "slope of epsi_rad"),
        ("states.epsi_rad", 0.01745, "slope of epsi_rad"),
        ("states.epsi_rad", 57.3, "slope of epsi_rad"),
        ("states.epsi_rad", 0.0, "slope of epsi_rad"),
        ("states.vy_mps", -1.0, "sign of vy_mps"),
        ("states.vx_mps", 0.2777, "slope of ey_m"),
        ("states.vx_mps", 3.6, "slope of ey_m"),
        ("exogenous.curvature_per_m", -1.0, "curvature_per_m"),
        ("exogenous.curvature_per_m", 10.0, "curvature_per_m"),
        ("exogenous.curvature_per_m", 0.1, "curvature_per_m"),
        ("inputs.steer_rad", -1.0, "inputs.steer_rad"),
        ("inputs.steer_rad", 0.0, "inputs.steer_rad"),
        ("inputs.steer_rad", 0.01745, "inputs.steer_rad"),
        ("inputs.steer_rad", 18.5, "inputs.steer_rad"),
        ("commands.steer_rad", -1.0, "commands.steer_rad"),
        ("commands.steer_rad", 57.3, "commands.steer_rad"),
        ("commands.steer_rad", 0.1, "commands.steer_rad"),
    ],
)
def test_a_wrong_sign_or_factor_contradicts_a_relation_of_the_signal(signal, factor, broken):
    found = contradicted(slalom_drive(), {signal: factor}, noise=0.3)
    assert any(text.startswith(broken) for text in found), found


def test_what_cannot_be_compared_is_named_with_the_reason():
    straight = answers_of(slalom_drive(turn=0.0))
    assert "yes" not in str(straight)
    assert list(straight.values()).count("not compared: too little motion") == 6
    found = answers_of(with_columns(epsi_rad=np.full(TICKS, np.nan)))
    expected = "not compared: no samples of states.epsi_rad"
    assert found["slope of epsi_rad = yaw rate - curvature * v_x"] == expected


@pytest.mark.parametrize(
    "columns",
    [
        {"ey_m": slalom_drive()["states.ey_m"] + 3.5 * (np.arange(TICKS) % 160 > 80)},
        {"epsi_rad": slalom_drive()["states.epsi_rad"] + 0.01},
        {"yaw_rate_radps": slalom_drive()["states.yaw_rate_radps"] + 0.005},
        {"epsi_rad": np.roll(slalom_drive()["states.epsi_rad"], 1)},
    ],
    ids=["next lane", "offset of heading", "offset of yaw rate", "delay"],
)
def test_usual_errors_of_sensors_are_no_contradiction(columns):
    assert contradicted(with_columns(**columns)) == []


@pytest.mark.parametrize(("name", "value"), [("engage", 0.0), ("car_brakes", 1.0)])
def test_commands_that_the_car_does_not_follow_are_not_compared(name, value):
    columns = with_columns(engage=slalom_drive()["mission.engage"])
    columns["commands.steer_rad"] = -columns["commands.steer_rad"]
    found = answers_of(columns | {f"mission.{name}": np.full(TICKS, value)})
    assert "yes" not in str(found)
    answer = found["commands.steer_rad = wheel angle of the yaw rate"]
    assert answer.startswith("not compared: ")


@pytest.mark.parametrize(
    ("factor", "hint"), [(-1.0, "try sign = -1"), (0.1, "0.1 times as expected")]
)
def test_a_contradicted_relation_says_by_how_much(factor, hint):
    found = answers_of(slalom_drive(), {"states.epsi_rad": factor}, noise=0.0)
    assert hint in found["slope of epsi_rad = yaw rate - curvature * v_x"]
