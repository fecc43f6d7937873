"""Episodes of the simulated car, their slices, and the workers that make them."""

import hashlib

import numpy as np
import pytest

from offline.config import PAST_STEPS
from offline.data import generate as generate_module
from offline.data.generate import (
    EPISODE_STEPS,
    FIRST_EPSI_RAD,
    FIRST_EY_M,
    LARGEST_SIDESLIP_RAD,
    LOWEST_SPEED_MPS,
    SLICES,
    assemble,
    generate,
    is_kept,
    make_episode,
    plant_fingerprint,
)
from offline.data.recipe import Recipe, draw_conditions
from offline.data.recording import cut
from offline.data.signals import VEHICLE_ROLES
from offline.data.variation import VARIED, Variation
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.signals import VEHICLE
from sim_bridge.campaign import Backend
from sim_bridge.plant.protocol import PlantOutputs


@pytest.fixture(scope="module")
def episode():
    return make_episode(Recipe(), np.random.SeedSequence(11))


@pytest.fixture(scope="module")
def slices(episode):
    """The slices of one episode on a curved road."""
    made = assemble([episode._replace(curvature_per_m=4e-3)])
    return cut(made.recording, made.slices, VEHICLE, VEHICLE_ROLES)


def test_inputs_of_a_slice_are_those_held_after_each_state(episode, slices):
    assert np.array_equal(slices.u.reshape(-1, 3), np.float32(episode.inputs[PAST_STEPS:]))
    motion = np.float32(episode.motion[PAST_STEPS:])
    assert np.array_equal(slices.x[:, :-1, :3].reshape(-1, 3), motion[:-1])
    assert np.array_equal(slices.x[-1, -1, :3], motion[-1])


def test_each_slice_starts_with_its_own_lateral_and_heading_error(episode):
    first_errors = np.array([[2.0, 0.1], [-2.0, 0.0], [0.0, -0.1], [1.0, 0.05], [-1.0, 0.0]])
    made = assemble([episode._replace(curvature_per_m=0.0, first_errors=first_errors)])
    x = cut(made.recording, made.slices, VEHICLE, VEHICLE_ROLES).x
    # one period later, at up to 40 m/s and 0.1 rad: at most 0.1 m further
    assert np.allclose(x[:, 0, 4], first_errors[:, 0], atol=0.15)
    assert np.allclose(x[:, 0, 5], first_errors[:, 1], atol=0.015)


def test_episodes_are_concatenated_with_five_slices_each():
    made = generate(Recipe(), 4, seed=5, backend=Backend(jobs=1))
    assert made.recording.first.tolist() == [0, 421, 842, 1263]
    assert len(made.recording.x) == len(made.recording.u) == len(made.recording.w) == 4 * 421
    rows = made.slices.row.reshape(4, SLICES) - made.recording.first[:, None]
    assert rows.tolist() == [[20, 100, 180, 260, 340]] * 4
    assert made.slices.episode.tolist() == np.repeat(np.arange(4), 5).tolist()
    meant_for = made.recording.w[made.slices.row, 0]
    assert np.array_equal(np.float32(made.slices.anchor.curvature_per_m), meant_for)


CALM = {"first_speed_mps": (25.0, 25.0), "throttles": (0.3,), "drive_brake_coast": (1.0, 0.0, 0.0)}


def constant(**conditions: float) -> Recipe:
    """Calm drives under constant conditions; as many random numbers are drawn for each."""
    drawn = {name: (value, value) for name, value in conditions.items()}
    return Recipe(**CALM, variation=Variation(**drawn))


@pytest.mark.parametrize(
    ("name", "usual", "other"),
    [
        ("mass_factor", 1.0, 1.4),
        ("friction", 0.85, 0.6),
        ("payload_kg", 0.0, 300.0),
        ("stiffness_factor", 1.0, 0.8),
        ("bank_rad", 0.0, 0.1),
        ("grade_rad", 0.0, 0.08),
        ("wind_forward_mps", 0.0, -12.0),
        ("wind_left_mps", 0.0, 12.0),
    ],
)
def test_another_condition_changes_the_motion_and_not_the_inputs(name, usual, other):
    seed = np.random.SeedSequence(3)
    nominal, changed = (make_episode(constant(**{name: value}), seed) for value in (usual, other))
    assert nominal.rejected == changed.rejected == 0
    assert np.array_equal(nominal.inputs, changed.inputs)
    assert np.array_equal(nominal.first_errors, changed.first_errors)
    assert np.abs(nominal.motion - changed.motion).max() > 1e-2


def test_the_default_recipe_makes_the_same_bytes():
    """The digests of the data that shipped models were trained on depend on them.

    Rounded, because another processor makes other last digits.
    """
    recording = generate(Recipe(), 3, seed=0, backend=Backend(jobs=1)).recording
    numbers = [recording.x, recording.u, recording.w, recording.pose]
    text = ",".join(
        f"{round(float(value), 3) + 0.0:.3f}" for array in numbers for value in array.ravel()[::97]
    )
    assert hashlib.sha256(text.encode()).hexdigest()[:16] == "69d08a29cb793669"


def test_conditions_are_kept_when_a_drive_is_rejected():
    """Otherwise slippery roads, on which more drives are rejected, would be rarer than drawn."""
    slippery = Recipe(variation=Variation(friction=(0.25, 1.0)))
    seeds = np.random.SeedSequence(2).spawn(12)
    episodes = [make_episode(slippery, seed) for seed in seeds]
    assert sum(episode.rejected for episode in episodes) > 0
    for seed, episode in zip(seeds, episodes, strict=True):
        rng = np.random.default_rng(seed)
        drawn = draw_conditions(rng, slippery.variation, EPISODE_STEPS)
        assert np.array_equal(episode.conditions, drawn.rows)


def test_conditions_in_which_no_drive_is_kept_are_refused(monkeypatch):
    monkeypatch.setattr(generate_module, "MOST_REJECTED", 3)
    ice = Recipe(first_speed_mps=(35.0, 36.0), variation=Variation(friction=(0.1, 0.1)))
    with pytest.raises(DatasetError, match=r"friction_left 0\.1.*more friction"):
        make_episode(ice, np.random.SeedSequence(0))


def test_data_and_rejections_depend_on_recipe_and_seed_and_not_on_the_number_of_processes():
    """Of slow drives, some are rejected and drawn again."""
    slow = Recipe(first_speed_mps=(4.0, 9.0), drive_brake_coast=(0.5, 0.5, 0.0), variation=VARIED)
    reported = []
    alone = generate(slow, 22, seed=1, backend=Backend(jobs=1), on_progress=reported.append)
    together = generate(slow, 22, seed=1, backend=Backend(jobs=2))
    assert reported == [0, 20, 22]
    assert alone.rejected == together.rejected > 0
    for one, other in zip(alone.recording, together.recording, strict=True):
        assert np.array_equal(one, other)
    for one, other in zip(alone.slices.anchor, together.slices.anchor, strict=True):
        assert np.array_equal(one, other)
    first = alone.slices.anchor
    for errors, bound in ((first.ey_m, FIRST_EY_M), (first.epsi_rad, FIRST_EPSI_RAD)):
        assert 0.9 * bound < errors.max() <= bound
        assert -bound <= errors.min() < -0.9 * bound
    assert alone.recording.x[:, 0].min() >= LOWEST_SPEED_MPS


@pytest.mark.parametrize(
    ("column", "value", "is_fine"),
    [
        ("sideslip_rad", -1.01 * LARGEST_SIDESLIP_RAD, False),
        ("sideslip_rad", 0.99 * LARGEST_SIDESLIP_RAD, True),
        ("roll_rad", 0.3, False),
        ("vx_mps", 0.99 * LOWEST_SPEED_MPS, False),
        ("vx_mps", np.nan, False),
    ],
)
def test_episodes_that_skid_roll_or_crawl_are_rejected(column, value, is_fine):
    motion, outputs = np.tile([20.0, 0.0, 0.0], (101, 1)), np.zeros((5, len(PlantOutputs._fields)))
    if column == "vx_mps":
        motion[50, 0] = value
    else:
        outputs[2, PlantOutputs._fields.index(column)] = value
    assert is_kept(motion, outputs) == is_fine


def test_the_fingerprint_of_the_car_is_repeatable_and_tells_variation():
    assert plant_fingerprint() == plant_fingerprint()
    assert plant_fingerprint(VARIED) == plant_fingerprint(VARIED) != plant_fingerprint()
