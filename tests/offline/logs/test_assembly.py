"""Episodes are joined to a recording with windows, and assigned to three parts."""

import numpy as np
import pandas as pd
import pytest
from made_logs import MAPPING, POSE

from offline.config import PAST_STEPS, STEPS
from offline.data.recording import cut
from offline.data.signals import VEHICLE_ROLES
from offline.logs.episode import LogEpisode, assign_parts, join_episodes, roads_of, slice_windows
from offline.logs.mapping import SplitSettings
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.contract.signals import VEHICLE, Schema, Signal

SIGNALS = ["vx_mps", "vy_mps", "yaw_rate_radps", "road_wheel_rad", "force_n", "brake_n"]
BRAKE = 'brake_n = { column = "side", unit = "N" }\n'
ROADS = "roads = { curvatures_per_m = [0.0, 0.01], ey_m = 1.0, epsi_deg = 5.0 }\n"


def episode(samples):
    rng = np.random.default_rng(samples)
    pose = np.cumsum(rng.uniform(0.0, 0.5, (samples, 3)), axis=0) * (1.0, 0.1, 0.01)
    signals = pd.DataFrame(rng.normal(size=(samples, 6)), columns=SIGNALS)
    return LogEpisode("a.csv", 0.0, signals, pose)


def test_episodes_are_joined_in_order_and_without_poses_if_the_mapping_has_none(parse):
    recording = join_episodes([episode(101), episode(300)], parse())
    assert recording.first.tolist() == [0, 101]
    assert recording.lengths.tolist() == [101, 300]
    assert not recording.has_poses
    np.testing.assert_array_equal(
        recording.x[101:], episode(300).signals[SIGNALS[:3]].astype(np.float32)
    )


def test_windows_are_placed_side_by_side_after_the_past_of_the_first(parse):
    recording = join_episodes([episode(101), episode(180), episode(181)], parse())
    slices = slice_windows(recording, None, 0)
    assert slices.row.tolist() == [20, 121, 301, 381]
    assert slices.episode.tolist() == [0, 1, 2, 2]
    ends = slices.row + STEPS
    assert ends[-1] == len(recording.x) - 1, "an episode that fits exactly is used to its end"


def test_a_window_has_the_measured_signals_and_their_past(parse):
    mapping = parse()
    recording = join_episodes([episode(200)], mapping)
    signals = [Signal(name, "") for name in SIGNALS]
    schema = Schema(tuple(signals[:3]), tuple(signals[3:5]), (), 0.025)
    window = cut(recording, slice_windows(recording, None, 0), schema, mapping.resolve_roles())
    np.testing.assert_array_equal(window.x[0], recording.x[20:101])
    np.testing.assert_array_equal(window.past[0, :, :3], recording.x[:20])
    np.testing.assert_array_equal(window.past[0, :, 3:], recording.u[:20])
    assert window.w.shape == (2, STEPS, 0)


def test_each_window_with_poses_gets_a_random_road(parse):
    mapping = parse(MAPPING + BRAKE + POSE + ROADS)
    episodes = [episode(PAST_STEPS + 40 * STEPS + 1)]
    recording, roads = join_episodes(episodes, mapping), roads_of(mapping)
    slices = slice_windows(recording, roads, 0)
    assert set(slices.anchor.curvature_per_m) == {0.0, 0.01}
    assert np.max(np.abs(slices.anchor.ey_m)) <= 1.0
    assert np.max(np.abs(slices.anchor.epsi_rad)) <= np.radians(5.0)
    windows = cut(recording, slices, VEHICLE, VEHICLE_ROLES)
    assert windows.x.shape == (40, 81, 6)
    assert np.isfinite(windows.x).all()
    assert np.std(windows.x[:, 0, 4]) > 0.3


FILES = [f"run_{k // 4}.csv" for k in range(40)]


def parts_of(files, part):
    return {file: set(part[[f == file for f in files]].tolist()) for file in files}


@pytest.mark.parametrize(
    ("settings", "counts"),
    [
        (SplitSettings(), [32, 4, 4]),
        (SplitSettings(share=0.2), [24, 8, 8]),
        (SplitSettings(by="file"), [32, 4, 4]),
        (SplitSettings(by="file", test=("run_0.csv",)), [32, 4, 4]),
    ],
)
def test_a_share_of_the_episodes_or_files_is_drawn_for_each_part(settings, counts):
    part = assign_parts(FILES, settings)
    assert np.bincount(part).tolist() == counts
    assert np.array_equal(part, assign_parts(FILES, settings))
    if settings.by == "file":
        assert all(len(parts) == 1 for parts in parts_of(FILES, part).values())
    if settings.test:
        assert parts_of(FILES, part)["run_0.csv"] == {2}


def test_another_seed_draws_others():
    drawn = (assign_parts(FILES, SplitSettings(seed=seed)) for seed in (0, 1))
    assert not np.array_equal(*drawn)


def test_named_files_are_the_only_ones_in_their_part():
    settings = SplitSettings(validation=("run_1.csv",), test=("run_[23].csv",))
    assert parts_of(FILES, assign_parts(FILES, settings)) == {
        f"run_{k}.csv": {{1: 1, 2: 2, 3: 2}.get(k, 0)} for k in range(10)
    }


@pytest.mark.parametrize(
    ("files", "settings", "message"),
    [
        (["a", "b"], {}, "longest_episode_s"),
        (["a", "b"], {"validation": ("a",), "test": ("b",)}, "none for train"),
        (FILES, {"test": ("run_99.csv",)}, r"'run_99\.csv', which fits none"),
        (FILES, {"validation": ("run_1.csv",), "test": ("run_1*",)}, r"in test: run_1\.csv"),
    ],
)
def test_a_split_without_three_parts_is_refused(files, settings, message):
    with pytest.raises((ConfigError, DatasetError), match=message):
        assign_parts(files, SplitSettings(**settings))
