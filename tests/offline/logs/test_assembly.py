"""Episodes become a recording, and windows of it that every model is judged on."""

from pathlib import Path

import numpy as np
from made_logs import MAPPING, POSE, schema_of

from offline.lengths import PAST_STEPS, STEPS
from offline.logs.assembly import assemble, roads_of, slice_windows
from offline.logs.episode import Episode
from offline.recording import cut
from offline.roles import VEHICLE_ROLES
from rt_controller.contract.schema import VEHICLE

ROADS = "roads = { curvatures_per_m = [0.0, 0.01], ey_m = 1.0, epsi_deg = 5.0 }\n"


def episode(samples, states=3, inputs=2, exogenous=0):
    dice = np.random.default_rng(samples)
    pose = np.cumsum(dice.uniform(0.0, 0.5, (samples, 3)), axis=0) * (1.0, 0.1, 0.01)
    return Episode(
        Path("a.csv"),
        0.0,
        dice.normal(size=(samples, states)),
        dice.normal(size=(samples, inputs)),
        np.zeros((samples, exogenous)),
        pose,
    )


def test_episodes_follow_each_other_without_poses_where_none_are_asked_for(parse):
    recording = assemble([episode(101), episode(300)], parse())
    assert recording.first.tolist() == [0, 101]
    assert recording.lengths.tolist() == [101, 300]
    assert not recording.has_poses
    np.testing.assert_array_equal(recording.x[101:], episode(300).x.astype(np.float32))


def test_windows_lie_side_by_side_after_the_past_of_the_first(parse):
    recording = assemble([episode(101), episode(180), episode(181)], parse())
    slices = slice_windows(recording, None, 0)
    assert slices.row.tolist() == [20, 121, 301, 381]
    assert slices.episode.tolist() == [0, 1, 2, 2]
    ends = slices.row + STEPS
    assert ends[-1] == len(recording.x) - 1, "a whole episode is used where it fits"


def test_a_window_holds_what_was_measured_and_what_came_before(parse):
    mapping = parse()
    recording = assemble([episode(200)], mapping)
    schema = schema_of(mapping)
    window = cut(recording, slice_windows(recording, None, 0), schema, mapping.resolve_roles())
    np.testing.assert_array_equal(window.x[0], recording.x[20:101])
    np.testing.assert_array_equal(window.past[0, :, :3], recording.x[:20])
    np.testing.assert_array_equal(window.past[0, :, 3:], recording.u[:20])
    assert window.w.shape == (2, STEPS, 0)


def test_each_window_with_poses_has_a_road_of_its_own(parse):
    mapping = parse(MAPPING + POSE + ROADS)
    episodes = [episode(PAST_STEPS + 40 * STEPS + 1, 3, 3, 1)]
    recording, roads = assemble(episodes, mapping), roads_of(mapping)
    slices = slice_windows(recording, roads, 0)
    assert set(slices.anchor.curvature_per_m) == {0.0, 0.01}
    assert np.max(np.abs(slices.anchor.ey_m)) <= 1.0
    assert np.max(np.abs(slices.anchor.epsi_rad)) <= np.radians(5.0)
    windows = cut(recording, slices, VEHICLE, VEHICLE_ROLES)
    assert windows.x.shape == (40, 81, 6)
    assert np.isfinite(windows.x).all()
    assert np.std(windows.x[:, 0, 4]) > 0.3
