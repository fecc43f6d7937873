"""Windows of recorded episodes: rows, past, and poses projected onto a road."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offline.config import PAST_STEPS, STEPS
from offline.data.recording import (
    Anchor,
    Recording,
    Starts,
    cut,
    possible_starts,
)
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


def test_progress_of_the_first_state_is_that_of_the_period_before():
    """0.5 m per period at 0.1 rad to the road, anchored one period earlier."""
    window = cut(straight_drive(100), on_road(15, 0.0, 1.0, 0.1), VEHICLE, VEHICLE_ROLES, 4, 3)
    along, beside = 0.5 * np.cos(0.1), 0.5 * np.sin(0.1)
    np.testing.assert_allclose(window.x[0, :, 3], along, rtol=1e-6)
    np.testing.assert_allclose(window.x[0, :, 4], 1.0 + beside * np.arange(1, 6), rtol=1e-6)
    np.testing.assert_allclose(window.x[0, :, 5], 0.1, rtol=1e-6)


@pytest.mark.parametrize("curvature", [-4e-3, -1e-9, 0.0, 1e-9, 2e-3])
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


def test_windows_are_the_rows_of_the_recording_in_the_order_of_their_starts():
    """Without poses, states and exogenous signals are those recorded."""
    windows = cut_plain([16, 5])
    assert windows.x[0].tolist() == [[t, -t] for t in range(16, 21)]
    assert windows.w[0].tolist() == [[32], [34], [36], [38]]
    assert windows.u[1, :, 0].tolist() == [5.25, 6.25, 7.25, 8.25]
    assert windows.past[1].tolist() == [[-2, 2.5], [-3, 3.5], [-4, 4.5]]
    assert windows.episode.tolist() == [0, 1]
    assert cut_plain([0], past_steps=0).past.shape == (1, 0, 2)
