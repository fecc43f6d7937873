"""Windows of recorded episodes: rows, past and road."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offline.config import PAST_STEPS, STEPS
from offline.data.recording import Anchor, Recording, Starts, cut, possible_starts
from offline.data.signals import VEHICLE_ROLES, Roles, mirror_signs
from rt_controller.contract.signals import VEHICLE, Schema, Signal
from sim_bridge.frenet import integrate_poses
from sim_bridge.plant.library import settle, simulate
from sim_bridge.plant.parameters import default_car

PLAIN = Schema(
    states=(Signal("depth_m", "m"), Signal("speed_mps", "m/s")),
    inputs=(Signal("thrust_n", "N"), Signal("rudder_rad", "rad")),
    exogenous=(Signal("current_mps", "m/s"),),
    dt_s=0.1,
)
PLAIN_ROLES = Roles(centred=(), odd=None, past=("speed_mps", "rudder_rad"))


def plain_recording(lengths: tuple[int, ...]) -> Recording:
    """Row t: depth t, speed -t, thrust t + 0.25, rudder t + 0.5, current 2t."""
    t = np.arange(sum(lengths), dtype=np.float32)
    return Recording(
        x=np.column_stack([t, -t]),
        u=np.column_stack([t + 0.25, t + 0.5]),
        w=2.0 * t[:, None],
        pose=np.zeros((0, 3)),
        first=np.cumsum([0, *lengths[:-1]]),
    )


def cut_plain(rows: list[int], steps: int = 4, past_steps: int = 3):
    starts = Starts(np.array(rows), np.arange(len(rows), dtype=np.int32), None)
    return cut(plain_recording((12, 12)), starts, PLAIN, PLAIN_ROLES, steps, past_steps)


def straight_drive(samples: int, speed_mps: float = 20.0) -> Recording:
    """A car that moves straight along X, recorded with poses."""
    t_s = VEHICLE.dt_s * np.arange(samples)
    rng = np.random.default_rng(0)
    return Recording(
        x=np.tile(np.float32([speed_mps, 0.0, 0.0]), (samples, 1)),
        u=rng.uniform(size=(samples, 3)).astype(np.float32),
        w=np.zeros((samples, 1), dtype=np.float32),
        pose=np.column_stack([speed_mps * t_s, np.zeros((samples, 2))]),
        first=np.array([0]),
    )


def on_road(row: int, curvature: float, ey: float, epsi: float) -> Starts:
    anchor = Anchor(*(np.array([value]) for value in (curvature, ey, epsi)))
    return Starts(np.array([row]), np.array([0], dtype=np.int32), anchor)


def test_a_window_has_its_states_and_the_inputs_between_them():
    window = cut_plain([5])
    assert window.x[0, :, 0].tolist() == [5, 6, 7, 8, 9]
    assert window.u[0, :, 0].tolist() == [5.25, 6.25, 7.25, 8.25]


def test_the_past_is_the_states_and_inputs_before_the_start_oldest_first():
    window = cut_plain([5])
    assert window.past[0].tolist() == [[-2, 2.5], [-3, 3.5], [-4, 4.5]]


def test_without_poses_states_and_exogenous_signals_are_those_recorded():
    window = cut_plain([15])
    assert window.x[0].tolist() == [[t, -t] for t in range(15, 20)]
    assert window.w[0].tolist() == [[30], [32], [34], [36]]


def test_windows_have_the_order_and_the_episodes_of_their_starts():
    windows = cut_plain([16, 3, 5])
    assert windows.x[:, 0, 0].tolist() == [16, 3, 5]
    assert windows.episode.tolist() == [0, 1, 2]


def test_neighbouring_windows_share_their_boundary_state():
    one, other = cut_plain([3]), cut_plain([7])
    assert np.array_equal(one.x[0, -1], other.x[0, 0])


def test_the_past_of_zero_steps_is_empty():
    assert cut_plain([0], past_steps=0).past.shape == (1, 0, 2)


def test_progress_of_the_first_state_is_that_of_the_period_before():
    """0.5 m per period at 0.1 rad to the road, anchored one period earlier."""
    window = cut(straight_drive(100), on_road(15, 0.0, 1.0, 0.1), VEHICLE, VEHICLE_ROLES, 4, 3)
    along, beside = 0.5 * np.cos(0.1), 0.5 * np.sin(0.1)
    np.testing.assert_allclose(window.x[0, :, 3], along, rtol=1e-6)
    np.testing.assert_allclose(window.x[0, :, 4], 1.0 + beside * np.arange(1, 6), rtol=1e-6)
    np.testing.assert_allclose(window.x[0, :, 5], 0.1, rtol=1e-6)


def test_curvature_is_that_of_the_anchor_and_not_the_recorded_one():
    drive = straight_drive(100)
    drive.w.fill(9.0)
    window = cut(drive, on_road(15, 4e-3, 0.0, 0.0), VEHICLE, VEHICLE_ROLES, 4, 3)
    assert window.w.shape == (1, 4, 1)
    assert np.all(window.w == np.float32(4e-3))


def test_the_road_does_not_change_motion_inputs_or_past():
    drive = straight_drive(130)
    here = cut(drive, on_road(25, 0.0, 0.0, 0.0), VEHICLE, VEHICLE_ROLES)
    there = cut(drive, on_road(25, -4e-3, 2.0, -0.1), VEHICLE, VEHICLE_ROLES)
    assert np.array_equal(here.x[..., :3], there.x[..., :3])
    assert np.array_equal(here.u, there.u)
    assert np.array_equal(here.past, there.past)
    assert not np.any(here.x[..., 4:] == there.x[..., 4:])


@pytest.mark.parametrize("curvature", [-4e-3, 0.0, 2e-3])
def test_path_states_equal_those_integrated_along_the_road(curvature):
    """Integration on a fine grid, compared with the poses of each period."""
    k = np.arange(PAST_STEPS + STEPS)
    inputs = np.column_stack([np.full(len(k), 0.3), 0.0 * k, 0.4 * np.sin(0.08 * k)])
    car = default_car()
    motion, _ = simulate(settle(25.0, car), inputs, car, 25, 1e-3)
    drive = Recording(
        x=motion[::25].astype(np.float32),
        u=np.vstack([inputs, inputs[-1:]]).astype(np.float32),
        w=np.zeros((len(k) + 1, 1), dtype=np.float32),
        pose=integrate_poses(motion, 0.0, 0.0, 0.0, 25, 1e-3),
        first=np.array([0]),
    )
    starts = on_road(PAST_STEPS, curvature, -1.5, 0.08)
    window = cut(drive, starts, VEHICLE, VEHICLE_ROLES)

    road = integrate_poses(motion[25 * (PAST_STEPS - 1) :], curvature, -1.5, 0.08, 25, 1e-3)
    expected = np.column_stack(
        [motion[25 * PAST_STEPS :: 25], np.diff(road[:, 0]), road[1:, 1], road[1:, 2]]
    )
    np.testing.assert_allclose(window.x[0], expected, rtol=1e-6, atol=1e-6)


def mirrored(recording: Recording, starts: Starts) -> tuple[Recording, Starts]:
    """The same episodes and roads with left and right exchanged."""
    assert starts.anchor is not None
    seen_on_plane = VEHICLE.state_names[: recording.x.shape[1]]
    return (
        recording._replace(
            x=(recording.x * mirror_signs(seen_on_plane, VEHICLE_ROLES)).astype(np.float32),
            u=(recording.u * mirror_signs(VEHICLE.input_names, VEHICLE_ROLES)).astype(np.float32),
            w=-recording.w,
            pose=recording.pose * (1.0, -1.0, -1.0),
        ),
        starts._replace(anchor=Anchor(*(-column for column in starts.anchor))),
    )


def test_mirroring_changes_the_sign_of_odd_signals_only(toy_dataset):
    """The expected signs follow from mirroring the plane."""
    data = toy_dataset
    there = cut(*mirrored(data.recording, data.slices), VEHICLE, VEHICLE_ROLES)
    here = cut(data.recording, data.slices, VEHICLE, VEHICLE_ROLES)
    for found, original, names in (
        (there.x, here.x, VEHICLE.state_names),
        (there.u, here.u, VEHICLE.input_names),
        (there.w, here.w, VEHICLE.exogenous_names),
        (there.past, here.past, VEHICLE_ROLES.past),
    ):
        signs = [-1.0 if name in VEHICLE_ROLES.odd else 1.0 for name in names]
        assert np.array_equal(found, original * np.float32(signs))
        assert np.all(np.abs(original).max(axis=(0, 1)) > 0.0)


def test_mirroring_exchanges_left_and_right():
    """A positive lateral error is on the left."""
    names = VEHICLE.state_names + VEHICLE.input_names + VEHICLE.exogenous_names
    signs = dict(zip(names, mirror_signs(names, VEHICLE_ROLES), strict=True))
    assert signs == {
        "vx_mps": 1,
        "vy_mps": -1,
        "yaw_rate_radps": -1,
        "ds_m": 1,
        "ey_m": -1,
        "epsi_rad": -1,
        "throttle": 1,
        "brake_n": 1,
        "steer_rad": -1,
        "curvature_per_m": -1,
    }


def test_without_symmetry_no_sign_changes():
    assert mirror_signs(PLAIN.state_names, PLAIN_ROLES).tolist() == [1.0, 1.0]


@settings(derandomize=True, deadline=None)
@given(
    st.lists(st.integers(1, 140), min_size=1, max_size=6),
    st.integers(0, PAST_STEPS),
    st.booleans(),
    st.data(),
)
def test_past_and_window_of_a_start_lie_within_its_episode(lengths, past, has_poses, data):
    total = sum(lengths)
    recording = plain_recording(tuple(lengths))
    if has_poses:
        recording = recording._replace(pose=np.zeros((total, 3)))
    episodes = sorted(data.draw(st.sets(st.integers(0, len(lengths) - 1))))

    least = max(past, 1) if has_poses else past
    expected = []
    for e in episodes:
        first, last = sum(lengths[:e]), sum(lengths[: e + 1]) - 1
        expected += [r for r in range(first, last + 1) if r - least >= first and r + STEPS <= last]
    found = possible_starts(recording, np.array(episodes, dtype=np.int64), past)
    assert found.tolist() == expected


def test_an_episode_that_is_one_sample_too_short_has_no_window():
    just_long_enough = PAST_STEPS + STEPS + 1
    for length, windows in ((just_long_enough - 1, 0), (just_long_enough, 1)):
        recording = plain_recording((length,))
        assert len(possible_starts(recording, np.array([0]))) == windows


def test_lengths_are_those_of_the_episodes():
    assert plain_recording((5, 1, 9)).lengths.tolist() == [5, 1, 9]


def test_selected_starts_keep_their_roads():
    anchor = Anchor(np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]), np.array([7.0, 8.0, 9.0]))
    starts = Starts(np.array([10, 20, 30]), np.arange(3, dtype=np.int32), anchor)
    taken = starts.take(np.array([2, 0]))
    assert taken.row.tolist() == [30, 10]
    assert taken.episode.tolist() == [2, 0]
    assert [column.tolist() for column in taken.anchor] == [[3, 1], [6, 4], [9, 7]]
    assert Starts(starts.row, starts.episode, None).take(slice(1)).anchor is None
