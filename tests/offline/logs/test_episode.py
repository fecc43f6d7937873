"""Drives are cut into episodes without gaps, joined to windows, and assigned to three parts."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_logs import MAPPING, POSE, log_of, make_drive

from offline.config import PAST_STEPS, STEPS
from offline.data.recording import cut
from offline.data.signals import VEHICLE_ROLES
from offline.logs.episode import (
    LEAST_SAMPLES,
    LogEpisode,
    assign_parts,
    cut_drive,
    join_episodes,
    roads_of,
    sample_drive,
    slice_windows,
)
from offline.logs.mapping import SplitSettings
from offline.logs.signal import to_drive
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.contract.signals import VEHICLE
from rt_controller.mapping.reference_line import make_line


def to_log(made, keep=slice(None)):
    return log_of(made.time[keep], {name: v[keep] for name, v in made._asdict().items()})


def cut_made(parse, made, text=MAPPING, line=None, keep=slice(None)):
    mapping = parse(text)
    drive = to_drive(to_log(made, keep), mapping)
    return cut_drive(sample_drive(drive, mapping), mapping, line)


def test_a_drive_is_cut_at_gaps_and_short_stretches_are_listed_as_left_out(parse, made_drive):
    t = made_drive.time
    keep = (t < 10.0) | ((t > 12.0) & (t < 12.1)) | (t > 13.0)
    found = cut_made(parse, made_drive, keep=keep)
    assert found.stretches == 3
    assert [e.begin_s for e in found.episodes] == pytest.approx([0.0, 13.01])
    ((begin_s, end_s),) = found.left_out
    assert (begin_s, end_s) == pytest.approx((12.01, 12.085), abs=0.02)


@pytest.mark.parametrize(
    ("samples", "is_kept"), [(LEAST_SAMPLES, True), (LEAST_SAMPLES - 1, False)]
)
def test_an_episode_is_long_enough_for_one_window_and_its_past(parse, samples, is_kept):
    found = cut_made(parse, make_drive((samples - 1) * 0.025, 0.005))
    assert (len(found.episodes), len(found.left_out)) == ((1, 0) if is_kept else (0, 1))


def test_long_stretches_are_cut_into_equal_pieces_that_share_no_sample(parse, made_drive):
    found = cut_made(parse, made_drive, MAPPING + "[split]\nlongest_episode_s = 8.0\n")
    lengths = [len(episode) for episode in found.episodes]
    assert sum(lengths) == 1201
    assert max(lengths) - min(lengths) <= 1
    ends = [e.begin_s + 0.025 * len(e) for e in found.episodes[:-1]]
    assert ends == pytest.approx([e.begin_s for e in found.episodes[1:]])


def circle_drive(duration_s=20.0, dt_s=0.01, radius_m=40.0, ey_m=1.5):
    """Around a circle with constant lateral error, 10 m/s along the line."""
    made = make_drive(duration_s, dt_s)
    angle = 10.0 * made.time / radius_m
    return made._replace(
        x=(radius_m - ey_m) * np.cos(angle),
        y=(radius_m - ey_m) * np.sin(angle),
        yaw=angle + np.pi / 2,
    )


def circle_line(radius_m=40.0):
    angle = np.linspace(0.0, 2 * np.pi, 200, endpoint=False)
    return make_line(radius_m * np.stack([np.cos(angle), np.sin(angle)]), True, 0.0, Path("l.csv"))


LINE = POSE + 'reference_line = "l.csv"\nclosed = true\n'


def test_path_states_are_relative_to_the_reference_line(parse):
    found = cut_made(parse, circle_drive(), MAPPING + LINE, circle_line())
    (episode,) = found.episodes
    assert len(episode) == 800, "the first sample has no progress and is left out"
    np.testing.assert_allclose(episode.signals["ds_m"], 0.25, atol=1e-4)
    np.testing.assert_allclose(episode.signals["ey_m"], 1.5, atol=1e-3)
    np.testing.assert_allclose(episode.signals["epsi_rad"], 0.0, atol=1e-4)
    np.testing.assert_allclose(episode.signals["curvature_per_m"], 1 / 40.0, rtol=1e-3)


def test_path_states_belong_to_the_same_instant_as_the_other_states(parse):
    made = make_drive(20.0)
    beside = 2.0 * np.sin(made.time)
    made = made._replace(x=10.0 * made.time, y=beside, yaw=np.arctan2(2.0 * np.cos(made.time), 10))
    points = np.stack([np.linspace(-20.0, 230.0, 60), np.zeros(60)])
    line = make_line(points, False, 0.0, Path("l.csv"))
    found = cut_made(parse, made, MAPPING + LINE.replace("true", "false"), line)
    (episode,) = found.episodes
    t = episode.begin_s + 0.025 * np.arange(len(episode))
    np.testing.assert_allclose(episode.signals["ey_m"], 2.0 * np.sin(t), atol=1e-3)
    heading = np.arctan2(2.0 * np.cos(t), 10)
    np.testing.assert_allclose(episode.signals["epsi_rad"], heading, atol=1e-3)
    at = np.interp(t, made.time, made.turn)
    np.testing.assert_allclose(episode.signals["yaw_rate_radps"], at, atol=3e-4)


def test_a_drive_is_cut_where_the_car_leaves_the_line(parse):
    made = circle_drive()
    away = (made.time > 8.0) & (made.time < 9.0)
    made.x[away] *= 1.6
    made.y[away] *= 1.6
    found = cut_made(parse, made, MAPPING + LINE, circle_line())
    assert len(found.episodes) == 2
    for episode in found.episodes:
        assert np.max(np.abs(episode.signals["ey_m"])) < 2.0


def test_samples_beyond_the_ends_of_an_open_line_are_left_out(parse):
    made = make_drive(20.0)
    made = made._replace(x=10.0 * made.time, y=0.0 * made.time, yaw=0.0 * made.time)
    points = np.stack([np.linspace(30.0, 130.0, 30), np.zeros(30)])
    line = make_line(points, False, 0.0, Path("l.csv"))
    found = cut_made(parse, made, MAPPING + LINE.replace("true", "false"), line)
    (episode,) = found.episodes
    assert episode.begin_s == pytest.approx(3.05, abs=0.03)
    assert episode.begin_s + 0.025 * len(episode) == pytest.approx(13.0, abs=0.05)
    assert found.off_line == pytest.approx(400, abs=5)


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
    another_seed = settings.model_copy(update={"seed": 1})
    assert not np.array_equal(part, assign_parts(FILES, another_seed))
    if settings.by == "file":
        assert all(len(parts) == 1 for parts in parts_of(FILES, part).values())
    if settings.test:
        assert parts_of(FILES, part)["run_0.csv"] == {2}


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
