"""A wrong sign or factor of a signal is found from a drive, by the relations that it breaks."""

from functools import cache

import numpy as np
import pytest

from rt_controller.contract.limits import DEFAULT_GEOMETRY, UNDERSTEER_RAD_PER_MPS2
from rt_controller.gateway.signal_relations import check_relations

SPEED_MPS, STEP_S, TICKS = 20.0, 0.025, 800
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
def drive(turn=1.0):
    """A slalom on a straight road, then a curve of it: columns by slot, every 25 ms."""
    time_s = STEP_S * np.arange(TICKS)
    curvature = np.where(time_s < 10.0, 0.0, 0.007 * turn)
    slalom = 0.12 * turn * np.cos(0.8 * np.pi * time_s) * (time_s < 10.0)
    yaw_rate = slalom + curvature * SPEED_MPS
    epsi = STEP_S * np.cumsum(slalom)
    vy = np.where(time_s < 10.0, -1.5 * yaw_rate, 0.0)
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


def check(columns, factors=(), noise=1.0, has_pose=False):
    rng, scale = np.random.default_rng(0), dict(factors)
    time_s = STEP_S * np.arange(TICKS)
    tracks = {}
    for name, values in columns.items():
        measured = values + noise * NOISE.get(name, 0.0) * rng.normal(size=TICKS)
        tracks[name] = list(zip(time_s, scale.get(name, 1.0) * measured, strict=True))
    return check_relations(tracks, has_pose, None)


def without(*names):
    return {name: values for name, values in drive().items() if name not in names}


@pytest.mark.parametrize("noise", [0.0, 1.0, 2.0])
@pytest.mark.parametrize("absent", [(), ("states.vy_mps",), ("commands.steer_rad",)])
def test_a_right_mapping_has_no_contradiction(noise, absent):
    found = check(without(*absent), noise=noise)
    assert found.contradictions == ()
    assert found.not_compared == ()


@pytest.mark.parametrize(
    "signal",
    [
        "states.yaw_rate_radps",
        "states.ey_m",
        "states.epsi_rad",
        "states.vy_mps",
        "exogenous.curvature_per_m",
        "inputs.steer_rad",
        "commands.steer_rad",
    ],
)
def test_a_wrong_sign_is_found(signal):
    found = check(drive(), {signal: -1.0}).contradictions
    assert found
    for problem, remedy in found:
        assert "found the opposite sign" in problem
        assert remedy.startswith(f"Correct `sign` of {problem.partition(':')[0]} or of a signal")


@pytest.mark.parametrize(
    ("signal", "factor"),
    [
        ("states.vx_mps", 0.2777),
        ("states.vx_mps", 3.6),
        ("states.yaw_rate_radps", 0.01745),
        ("states.yaw_rate_radps", 57.3),
        ("states.ey_m", 0.1),
        ("states.ey_m", 100.0),
        ("states.epsi_rad", 0.01745),
        ("states.epsi_rad", 57.3),
        ("exogenous.curvature_per_m", 10.0),
        ("exogenous.curvature_per_m", 0.1),
        ("inputs.steer_rad", 0.01745),
        ("inputs.steer_rad", 18.5),
        ("commands.steer_rad", 57.3),
        ("commands.steer_rad", 0.1),
    ],
)
def test_a_wrong_factor_is_found(signal, factor):
    assert check(drive(), {signal: factor}, noise=0.3).contradictions


def test_a_message_says_what_was_expected_and_found():
    ((problem, _),) = check(drive(), {"states.ey_m": 100.0}).contradictions
    assert problem.startswith("states.ey_m: expected a slope of v_x sin(e_psi) + v_y cos(e_psi), ")
    assert problem.endswith("times it (% taken for a ratio?)")


@pytest.mark.parametrize("signal", ["states.ey_m", "states.epsi_rad", "inputs.steer_rad"])
def test_a_signal_that_stays_at_zero_is_found(signal):
    found = check(drive(), {signal: 0.0}).contradictions
    assert any(problem.startswith(f"{signal}: ") for problem, _ in found)


def test_a_straight_drive_is_not_compared_and_no_contradiction():
    found = check(drive(turn=0.0))
    assert found.contradictions == ()
    assert [each.partition(" (")[0] for each in found.not_compared] == [
        "exogenous.curvature_per_m",
        "states.epsi_rad",
        "states.vy_mps",
        "states.ey_m",
        "inputs.steer_rad",
        "commands.steer_rad",
    ]


def test_a_missing_signal_is_said():
    found = check(without("inputs.steer_rad") | {"states.epsi_rad": np.full(TICKS, np.nan)})
    assert found.contradictions == ()
    assert "inputs.steer_rad (not mapped)" in found.not_compared


def test_a_step_of_the_lateral_position_to_the_next_lane_is_no_contradiction():
    columns = dict(drive())
    columns["states.ey_m"] = columns["states.ey_m"] + 3.5 * (np.arange(TICKS) % 160 > 80)
    assert check(columns).contradictions == ()


def test_constant_errors_of_the_sensors_are_no_contradiction():
    columns = dict(drive())
    for name, error in (("states.epsi_rad", 0.01), ("states.yaw_rate_radps", 0.005)):
        columns[name] = columns[name] + error
    assert check(columns).contradictions == ()


def test_commands_that_the_car_does_not_follow_are_not_compared():
    columns = dict(drive())
    columns["commands.steer_rad"] = -columns["commands.steer_rad"]
    for name, value in (("mission.engage", 0.0), ("mission.car_brakes", 1.0)):
        found = check(columns | {name: np.full(TICKS, value)})
        assert found.contradictions == ()
        assert any(each.startswith("commands.steer_rad") for each in found.not_compared)


def test_a_car_with_a_pose_needs_no_place_on_the_road():
    place = ("states.ey_m", "states.epsi_rad", "exogenous.curvature_per_m")
    found = check(without(*place), has_pose=True)
    assert found == ((), ())
