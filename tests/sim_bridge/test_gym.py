"""The Gymnasium environment: its interface, its meaning, agreement with a drive over the bus."""

import warnings
from collections.abc import Iterable, Iterator
from itertools import repeat
from typing import Any

import numpy as np
import pytest

from rt_controller import simulate
from rt_controller.contract.car import DEFAULT_CAR
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.timing import PERIOD_S
from sim_bridge import load_scenario, parse_scenario

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from sim_bridge.adapters.gym import CarEnv, ObservedValues  # noqa: E402

FAULTY = {
    "format": 2,
    "name": "a",
    "duration_s": 5.0,
    "reference": {"speed_kmh": 50.0},
    "faults": [{"kind": "drop", "messages": ["state"], "start_s": 1.0}],
}
MADE = "sim_bridge.adapters.gym:sim_bridge/Track-v0"


def steps(env: CarEnv, actions: Iterable[Any]) -> Iterator[tuple[Any, ...]]:
    """The steps of one episode, to its end."""
    for action in actions:
        found = env.step(np.asarray(action, np.float32))
        yield found
        if found[2] or found[3]:
            return


def test_gymnasium_accepts_the_environment_without_a_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(MADE, scenario="slalom", friction=(0.5, 0.9), start_ey_m=0.2)
        check_env(env.unwrapped)


def test_the_same_seed_and_actions_give_the_same_bytes() -> None:
    def drive(seed: int) -> bytes:
        env = CarEnv(["lane_change_60", "road_course"], mass_factor=(0.8, 1.2), friction=(0.4, 1.0))
        env.action_space.seed(0)
        first = [env.reset(seed=seed)[0] for _ in range(2)][1]
        rows = [step[0] for step in steps(env, (env.action_space.sample() for _ in range(60)))]
        return np.vstack([first, *rows]).tobytes()

    assert drive(1) == drive(1)
    assert drive(1) != drive(2)


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_environments_step_as_a_vector(mode: str) -> None:
    envs = gymnasium.make_vec(MADE, 2, vectorization_mode=mode, scenario="straight")
    seen, _ = envs.reset(seed=1)
    after, rewards, *_, info = envs.step(np.zeros((2, 2), np.float32))
    envs.close()
    assert seen.shape == after.shape == (2, len(ObservedValues._fields))
    assert rewards.shape == info["ey_error_m"].shape == (2,)


def wheel_share(steer_rad: float, vx_mps: float) -> float:
    """The action for an angle of the steering wheel."""
    limits = DEFAULT_CAR.plan_lateral_mps2, DEFAULT_CAR.largest_lateral_mps2
    return steer_rad / DEFAULT_CAR.geometry.largest_wheel_rad(vx_mps, *limits)


@pytest.mark.parametrize("scenario", ["double_lane_change", "road_course"])
def test_the_sent_inputs_of_a_drive_give_the_place_of_its_car(scenario: str) -> None:
    drive = simulate(scenario, duration_s=10.0)
    env = CarEnv(scenario)
    seen, info = env.reset()
    # Over the bus the car waits for the first command, which acts a period earlier than here.
    first = int(np.flatnonzero(drive["throttle"])[0]) + 1
    errors_m = []
    for row in range(first, first + 390):
        errors_m.append(info["ey_error_m"] - (drive["ey_m"] - drive["path_ey_m"])[row])
        pedals = drive["throttle"][row] - drive["brake_n"][row] / INPUT_LIMITS.upper.brake_n
        action = np.array([pedals, wheel_share(drive["steer_rad"][row], float(seen[0]))])
        seen, *_, info = env.step(action.astype(np.float32))

    assert np.abs(errors_m).max() < 0.01
    assert seen[0] == pytest.approx(drive["vx_mps"][row + 1], abs=0.02)


@pytest.mark.parametrize(
    ("action", "cause"),
    [((0.1, 1.0), "lane"), ((-1.0, 0.0), "speed")],
)
def test_an_episode_is_terminated_without_reward_where_the_car_is_lost(
    action: tuple[float, float], cause: str
) -> None:
    env = CarEnv("straight")
    env.reset()
    *_, (_, reward, is_lost, is_over, info) = steps(env, repeat(action))
    assert is_lost
    assert not is_over
    assert reward == 0.0
    assert (abs(info["ey_error_m"]) > 1.75) == (cause == "lane")
    assert (info["speed_error_mps"] < -10.0) == (cause == "speed")


def test_a_car_that_keeps_its_path_is_rewarded_to_the_end_of_the_scenario() -> None:
    scenario = load_scenario("straight")
    env = CarEnv(scenario)
    env.reset()
    episode = list(steps(env, repeat((0.1, 0.0))))
    assert len(episode) == scenario.ticks
    assert episode[-1][3]
    assert not episode[-1][2]
    assert min(step[1] for step in episode) > 0.5
    assert episode[-1][4]["ey_rms_m"] < 0.01


def test_the_reward_falls_with_errors_and_with_changes_of_the_inputs() -> None:
    def first_reward(action: tuple[float, float], **options: Any) -> float:
        env = CarEnv("straight", **options)
        env.reset(seed=3)
        return float(env.step(np.array(action, np.float32))[1])

    rewards = [
        first_reward((0.0, 0.0)),
        first_reward((0.0, 0.2)),
        first_reward((1.0, 0.2)),
        first_reward((1.0, 0.2), start_ey_m=1.0),
    ]
    assert rewards == sorted(rewards, reverse=True)
    assert len(set(rewards)) == 4


def test_an_action_acts_two_periods_later_and_within_the_rates() -> None:
    env = CarEnv("straight")
    env.reset()
    applied = [env.step(np.ones(2, np.float32))[4] for _ in range(4)]
    change_rad = INPUT_LIMITS.rate_per_s.steer_rad * PERIOD_S
    wheel_rad = [info["steer_rad"] for info in applied]
    assert wheel_rad == pytest.approx([0.0, 0.0, change_rad, 2.0 * change_rad])
    assert applied[2]["throttle"] == pytest.approx(INPUT_LIMITS.rate_per_s.throttle * PERIOD_S)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"friction": 0.0}, "friction"),
        ({"friction": (0.9, 0.5)}, "friction"),
        ({"mass_factor": 3.0}, "mass_factor"),
        ({"start_ey_m": -0.1}, "start_ey_m"),
        ({"scenario": "no such road"}, "no such road"),
        ({"car": "no such car"}, "no such car"),
        ({"scenario": parse_scenario(FAULTY, "a")}, "without .*faults"),
    ],
)
def test_an_option_that_does_not_fit_is_refused_by_name(options: Any, named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        CarEnv(**options)
