"""Episodes of the simulated car and how they are cut."""

import numpy as np
import pytest

from offline.excitation import Recipe, draw_inputs
from offline.generate import (
    EPISODE_STEPS,
    LARGEST_SIDESLIP_RAD,
    LOWEST_SPEED_MPS,
    generate,
    is_kept,
    make_episode,
    plant_fingerprint,
    slice_episode,
)
from sim_bridge.plant.integrate import settle, simulate
from sim_bridge.plant.monitor import Monitor
from sim_bridge.plant.parameters import C_CLASS_150KW_AWD


@pytest.fixture(scope="module")
def episode():
    return make_episode(Recipe(), 4, np.random.SeedSequence(11)).trajectories


def a_calm_log() -> tuple[np.ndarray, np.ndarray]:
    motion = np.zeros((101, 3))
    motion[:, 0] = 20.0
    return motion, np.zeros((5, len(Monitor._fields)))


def test_an_episode_is_five_slices_of_81_states_and_80_inputs(episode):
    assert episode.x.shape == (5, 81, 6)
    assert episode.u.shape == (5, 80, 3)
    assert np.all(episode.episode == 4)
    assert len(set(episode.kappa.tolist())) == 1


def test_neighbouring_slices_share_the_motion_at_their_boundary(episode):
    assert np.array_equal(episode.x[:-1, -1, :3], episode.x[1:, 0, :3])
    assert not np.any(np.isclose(episode.x[:-1, -1, 4], episode.x[1:, 0, 4]))


def test_progress_is_backward_also_at_the_first_state(episode):
    """s_k - s_(k-1) is the mean speed over the past period, seen along the road."""
    vx, vy, ds, ey, epsi = (episode.x[:, :, i].astype(float) for i in (0, 1, 3, 4, 5))
    along = (vx * np.cos(epsi) - vy * np.sin(epsi)) / (1 - episode.kappa[:, None] * ey)
    over_period = 0.025 * 0.5 * (along[:, 1:] + along[:, :-1])
    assert np.allclose(ds[:, 1:], over_period, atol=2e-3)
    assert np.allclose(ds[:, 0], 0.025 * along[:, 0], rtol=0.02)


def test_inputs_of_a_slice_are_those_held_from_each_state_to_the_next():
    rng = np.random.default_rng(3)
    inputs = draw_inputs(rng, Recipe(), EPISODE_STEPS + 1)
    motion, _ = simulate(settle(20.0, C_CLASS_150KW_AWD), inputs, C_CLASS_150KW_AWD, 25, 1e-3)
    x, u = slice_episode(motion, inputs, 2e-3, np.zeros((5, 2)))
    assert np.array_equal(u.reshape(-1, 3), inputs[1:])
    assert np.array_equal(x[:, :-1].reshape(-1, 6)[:, :3], motion[25:-25:25])
    assert np.array_equal(x[-1, -1, :3], motion[-1])


def test_lateral_and_heading_error_start_anew_in_each_slice():
    rng = np.random.default_rng(3)
    inputs = draw_inputs(rng, Recipe(), EPISODE_STEPS + 1)
    motion, _ = simulate(settle(20.0, C_CLASS_150KW_AWD), inputs, C_CLASS_150KW_AWD, 25, 1e-3)
    first_errors = np.array([[2.0, 0.1], [-2.0, 0.0], [0.0, -0.1], [1.0, 0.05], [-1.0, 0.0]])
    x, _ = slice_episode(motion, inputs, 0.0, first_errors)
    # one period later, at some 20 m/s and 0.1 rad: no more than 0.1 m on
    assert np.allclose(x[:, 0, 4], first_errors[:, 0], atol=0.1)
    assert np.allclose(x[:, 0, 5], first_errors[:, 1], atol=0.01)


def test_data_do_not_depend_on_the_number_of_processes():
    alone, together = (generate(Recipe(), 24, seed=5, jobs=jobs) for jobs in (1, 2))
    assert alone.rejected == together.rejected
    for one, other in zip(alone.trajectories, together.trajectories, strict=True):
        assert np.array_equal(one, other)


def test_progress_counts_every_episode():
    heard = []
    generate(Recipe(), 24, seed=5, jobs=1, on_progress=heard.append)
    assert sum(heard) == 24


def test_calm_driving_is_kept():
    assert is_kept(*a_calm_log())


@pytest.mark.parametrize(
    ("column", "value"),
    [("sideslip_rad", -1.01 * LARGEST_SIDESLIP_RAD), ("roll_rad", 0.3)],
)
def test_episodes_that_slide_or_tip_are_rejected(column, value):
    motion, monitor = a_calm_log()
    monitor[2, Monitor._fields.index(column)] = value
    assert not is_kept(motion, monitor)


@pytest.mark.parametrize("speed_mps", [0.99 * LOWEST_SPEED_MPS, np.nan])
def test_episodes_that_stop_or_blow_up_are_rejected(speed_mps):
    motion, monitor = a_calm_log()
    motion[50, 0] = speed_mps
    assert not is_kept(motion, monitor)


def test_kept_episodes_never_crawl(episode):
    assert episode.x[:, :, 0].min() >= LOWEST_SPEED_MPS


def test_rejected_tries_are_counted_and_drawn_again():
    slow = Recipe(first_speed_mps=(4.0, 9.0), drive_brake_coast=(0.5, 0.5, 0.0))
    made = generate(slow, 6, seed=1, jobs=1)
    assert made.rejected > 0
    assert len(made.trajectories.kappa) == 30


def test_fingerprint_of_the_car_is_reproducible():
    assert plant_fingerprint() == plant_fingerprint()
