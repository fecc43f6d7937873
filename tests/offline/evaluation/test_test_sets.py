"""The trajectories that models are evaluated on, and the parts of them that tables show."""

from dataclasses import replace

import numpy as np
import pytest
from toy_predictors import made_test_set, made_trajectories

from offline.config import PRESETS, STEPS
from offline.data.manifest import Roads
from offline.data.recording import Starts
from offline.data.signals import STANDARD_DEVIATIONS, VEHICLE_ROLES, Roles, past_names
from offline.evaluation import simulated_sets
from offline.evaluation.lane_change import WINDOWS, drive_lane_change
from offline.evaluation.parts import parts_of, whole_part
from offline.evaluation.simulated_sets import (
    SIMULATED,
    open_simulated_set,
    straight_braking_set,
)
from offline.evaluation.test_sets import (
    ROBUSTNESS,
    bends_sets,
    library_set,
    new_roads_set,
    noisy_set,
)
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import VEHICLE, InputColumn, Schema, Signal
from rt_controller.contract.timing import PERIOD_S


@pytest.fixture
def toy_dataset(toy_dataset):
    """Half of the episodes held out, so that every road is among them."""
    part = np.where(np.arange(len(toy_dataset.part)) % 2, 2, 0).astype(np.int8)
    return replace(toy_dataset, part=part)


@pytest.fixture
def without_roads(toy_dataset):
    """The toy data as from a log: states on the driven road, no poses."""
    recording = toy_dataset.recording
    x = np.concatenate([recording.x, recording.x], axis=1)
    recording = recording._replace(x=x, pose=np.zeros((0, 3)))
    slices = Starts(toy_dataset.slices.row, toy_dataset.slices.episode, None)
    manifest = replace(toy_dataset.manifest, roads=None)
    return replace(toy_dataset, recording=recording, slices=slices, manifest=manifest)


def roads_of(test):
    """The different curvatures in 1/m, ascending."""
    return np.unique(test.trajectories.w[:, 0, 0])


def test_the_library_has_test_episodes_only(toy_dataset):
    found = library_set(toy_dataset)
    assert set(found.trajectories.episode) == set(toy_dataset.episodes("test"))
    assert roads_of(found) == pytest.approx([-4e-3, 0.0, 4e-3])


def test_new_roads_have_the_same_drives(toy_dataset):
    """Motion and inputs are equal on all roads."""
    library, new = library_set(toy_dataset), new_roads_set(toy_dataset)
    n = len(library.trajectories.episode)
    assert roads_of(new) == pytest.approx([-1e-3, 1e-3, 3e-3])
    assert whole_part(new).n_trajectories == 3 * n
    assert whole_part(new).n_episodes == whole_part(library).n_episodes
    for road in range(3):
        laid = new.trajectories.take(slice(road * n, (road + 1) * n))
        assert np.array_equal(laid.x[..., :3], library.trajectories.x[..., :3])
        for name in ("u", "past", "episode"):
            assert np.array_equal(getattr(laid, name), getattr(library.trajectories, name))
        assert np.all(laid.w == np.float32((-1e-3, 1e-3, 3e-3)[road]))


def test_curvatures_of_the_library_are_not_among_the_new_ones(toy_dataset):
    roads = Roads((-1e-3, 0.0, 1e-3), 2.0, 0.15)
    manifest = replace(toy_dataset.manifest, roads=roads)
    few = new_roads_set(replace(toy_dataset, manifest=manifest))
    assert roads_of(few) == pytest.approx([3e-3])
    every = replace(toy_dataset.manifest, roads=Roads((-1e-3, 1e-3, 3e-3), 2.0, 0.15))
    assert new_roads_set(replace(toy_dataset, manifest=every)) is None


def test_bends_are_of_one_side_and_of_radii_that_a_car_can_drive(toy_dataset):
    found = bends_sets(toy_dataset)
    assert found
    assert {test.name for test in found} <= {"bends-left", "bends-right"}
    for test in found:
        curvature = test.trajectories.w[:, 0, 0] * (1.0 if test.name == "bends-left" else -1.0)
        assert np.all((curvature >= 1.0 / 250.0) & (curvature <= 1.0 / 8.0))
        episodes = toy_dataset.episodes("test")
        assert np.isin(test.trajectories.episode, episodes).all()


def test_data_without_roads_have_a_library_and_no_new_roads(without_roads):
    library = library_set(without_roads)
    assert whole_part(library).n_trajectories == 5 * len(without_roads.episodes("test"))
    assert new_roads_set(without_roads) is None
    assert bends_sets(without_roads) == []


LIBRARY = made_test_set(made_trajectories(4_000))
HEARD = past_names(VEHICLE, VEHICLE_ROLES)


def test_states_of_unknown_noise_have_no_noisy_set():
    schema = Schema((Signal("heat_k", "K"),), (), (), 0.1)
    test = made_test_set(made_trajectories(5, states=1))
    assert noisy_set(test, 1.0, schema, Roles((), None, ())) is None


BY_NAME = {each.name: each for each in SIMULATED}


@pytest.fixture(autouse=True)
def own_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_the_data_are_made_once_and_used_whole(monkeypatch):
    few = replace(BY_NAME[ROBUSTNESS], episodes=3)
    dataset, test = open_simulated_set(few)
    assert (whole_part(test).n_trajectories, whole_part(test).n_episodes) == (15, 3)
    assert "road friction 0.5 to 1, mass times 0.85 to 1.15" in test.description
    monkeypatch.setattr(simulated_sets, "make_dataset", None)
    assert open_simulated_set(few)[0].sha256 == dataset.sha256


def test_no_preset_trains_with_the_seeds_of_these_sets():
    trained = {preset.data_seed for preset in PRESETS.values()}
    assert trained.isdisjoint(each.seed for each in SIMULATED)


def test_the_same_drivers_drive_on_every_friction_and_with_every_mass():
    nominal = open_simulated_set(replace(BY_NAME["nominal"], episodes=2))[1].trajectories
    for which in (BY_NAME["friction-1"], BY_NAME["mass-1.15"]):
        other = open_simulated_set(replace(which, episodes=2))[1].trajectories
        assert np.array_equal(other.u, nominal.u)
        assert not np.allclose(other.x[:, -1, :3], nominal.x[:, -1, :3], atol=1e-3)


@pytest.fixture(scope="module")
def stops():
    return straight_braking_set()


def test_every_stop_reaches_the_full_brake_within_the_limits_of_the_inputs(stops):
    u = stops.trajectories.u
    brake_n = u[..., InputColumn.brake_n]
    assert np.all(brake_n[:, -1] == INPUT_LIMITS.upper.brake_n)
    assert np.all(u[..., [InputColumn.throttle, InputColumn.steer_rad]] == 0.0)
    change = np.diff(brake_n, axis=1) / PERIOD_S
    assert change.max() <= INPUT_LIMITS.rate_per_s.brake_n * 1.001
    assert change.min() >= 0.0


COUNT = 20


def made_set(name="library", count=COUNT, **columns):
    """Trajectories at 20 m/s, straight and without pedals, but for these (count, K) columns."""
    made = made_trajectories(count)
    x, u, w = (np.zeros_like(array) for array in made[:3])
    x[..., 0] = 20.0
    for column, values in columns.items():
        if column in VEHICLE.state_names:
            x[..., VEHICLE.state_names.index(column)] = values
        else:
            u[..., VEHICLE.input_names.index(column)] = values
    return made_test_set(made._replace(x=x, u=u, w=w), name=name)


def slices_of(*sets):
    """Name and number of trajectories of the parts that are not whole sets."""
    parts = parts_of(sets, VEHICLE)
    assert [part.name for part in parts[: len(sets)]] == [test.name for test in sets]
    return {part.name: part.n_trajectories for part in parts[len(sets) :]}


def test_sideslip_is_the_largest_of_either_side_within_the_two_seconds():
    """Ten trajectories without sideslip, ten with one instant of sideslip, to both sides."""
    vy = np.zeros((COUNT, 81))
    angles_deg = [-3.0, 3.0, 5.0, -5.0, 7.0, -7.0, 10.0, -10.0, 14.0, -14.0]
    vy[10:, 33] = 20.0 * np.tan(np.radians(angles_deg))
    counts = {"0 to 2": 10, "2 to 4": 2, "4 to 6": 2, "6 to 9": 2, "9 to 16": 4}
    assert slices_of(made_set(vy_mps=vy)) == {
        f"library, largest sideslip {limits} deg": count for limits, count in counts.items()
    }


def test_braking_is_none_light_and_hard():
    brake_n = np.zeros((COUNT, 80))
    brake_n[5:, 40] = 30.0
    brake_n[12:, 41] = 75.0
    assert slices_of(made_set(brake_n=brake_n), made_set("braking", 7)) == {
        "library, largest brake 0 N": 5,
        "library, largest brake 0 to 75 N": 7,
        "library, largest brake 75 N and more": 8,
    }


def test_first_speeds_are_parts_of_the_library_and_of_the_fast_set():
    first_kmh = np.append(np.linspace(20.0, 140.0, COUNT - 1), 250.0)
    library = made_set(vx_mps=first_kmh[:, None] / 3.6)
    fast = made_set("fast", 4, vx_mps=np.array([[120.0], [140.0], [160.0], [170.0]]) / 3.6)
    found = slices_of(library, fast)
    assert [*found][-3:] == [
        "library, first speed 145 km/h and more",
        "fast, first speed 130 to 150 km/h",
        "fast, first speed 150 to 180 km/h",
    ]
    assert sum(found.values()) == COUNT + 3


def test_each_road_of_the_library_is_a_part(toy_dataset):
    found = slices_of(library_set(toy_dataset))
    roads = [name for name in found if "curvature" in name]
    assert roads == [f"library, curvature {kappa} 1/m" for kappa in ("-0.004", "0", "0.004")]
    assert sum(found[name] for name in roads) == len(library_set(toy_dataset).trajectories.episode)


@pytest.fixture(scope="module")
def driven():
    return drive_lane_change()


def test_speed_road_and_displacement_are_those_of_the_paper(driven):
    """80 km/h, curvature 0.001, a lane to the left and back."""
    x = driven.windows.x
    assert np.all(driven.windows.w == np.float32(1e-3))
    assert np.allclose(3.6 * x[..., 0], 80.0, atol=1.0)
    assert x[..., 4].max() == pytest.approx(3.5, abs=0.2)
    assert np.abs(x[-1, -1, 4]) < 0.1
    assert "80 km/h" in driven.description
    assert "0.001 1/m" in driven.description


def test_the_noise_of_first_state_and_past_has_the_stated_standard_deviations():
    """Progress is that of the noisy speed; the level scales one fixed draw."""
    noisy, clean = noisy_set(LIBRARY, 1.0, VEHICLE, VEHICLE_ROLES), LIBRARY.trajectories
    found, three = noisy.trajectories, noisy_set(LIBRARY, 3.0, VEHICLE, VEHICLE_ROLES).trajectories
    assert noisy.name == "noise-1"
    assert np.array_equal(found.x[:, 1:], clean.x[:, 1:])
    for name in ("u", "w", "episode"):
        assert np.array_equal(getattr(found, name), getattr(clean, name))
    at_start = (found.x - clean.x)[:, 0].astype(float)
    before = (found.past - clean.past).astype(float)
    for name, expected in STANDARD_DEVIATIONS.items():
        column = VEHICLE.state_names.index(name)
        assert at_start[:, column].std() == pytest.approx(expected, rel=0.05)
        assert abs(at_start[:, column].mean()) < 0.1 * expected
        if name in HEARD:
            assert before[..., HEARD.index(name)].std() == pytest.approx(expected, rel=0.02)
    speed, progress = (VEHICLE.state_names.index(name) for name in ("vx_mps", "ds_m"))
    assert np.allclose(at_start[:, progress], VEHICLE.dt_s * at_start[:, speed], atol=1e-6)
    last = before[:, -1, HEARD.index("vx_mps")]
    assert abs(np.corrcoef(at_start[:, speed], last)[0, 1]) < 0.06
    for name in set(HEARD) & set(VEHICLE.input_names):
        assert np.all((three.past - clean.past)[..., HEARD.index(name)] == 0.0)
    assert np.allclose((three.x - clean.x)[:, 0], 3.0 * at_start, atol=1e-6)


def test_data_without_a_test_part_are_refused_and_few_of_each_curvature_can_be_taken(toy_dataset):
    few = library_set(toy_dataset, per_curvature=3)
    assert {3} == set(np.unique(few.trajectories.w[:, 0, 0], return_counts=True)[1])
    learned = replace(toy_dataset, part=np.zeros_like(toy_dataset.part))
    with pytest.raises(DatasetError, match="test trajectories"):
        library_set(learned)


def test_windows_of_the_lane_change_are_consecutive_and_keep_to_the_path(driven):
    x, time_s = driven.windows.x, driven.time_s
    assert x.shape == (WINDOWS, STEPS + 1, 6)
    assert np.allclose(x[1:, 0], x[:-1, -1], atol=1e-5)
    assert time_s[-1, -1] == pytest.approx(2.0 * WINDOWS)
    assert np.abs(x[..., 4] - driven.desired_ey_m).max() < 0.2
