"""Recorded episodes of any length, one sample per period, and the windows cut from them.

A recording without poses holds all states as measured. One with poses holds the first states of
the schema; the path states progress, e_y and e_psi are computed when a window is placed on a road.
The motion on a plane does not depend on the road, so one episode can be used with any road near
its start: the reference circle is placed such that lateral and heading error have given values at
one instant, and every other pose is projected onto it. This is exact; integrating along the road
would be approximate.
Paper: eq. (2), "set of states and inputs".
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.config import PAST_STEPS, STEPS
from offline.data.signals import Array32, Roles, Rows, Trajectories, past_columns
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import Schema
from rt_controller.model.path_kinematics import project

PATH_STATES = ("ds_m", "ey_m", "epsi_rad")
"""the last states of the car's schema, which a recording with poses does not contain"""


class Anchor(NamedTuple):
    """The road of each trajectory: its curvature, and the errors at the first pose."""

    curvature_per_m: Array
    """(N,)"""
    ey_m: Array
    """(N,)"""
    epsi_rad: Array
    """(N,)"""


class RoadPose(NamedTuple):
    """Positions in the Frenet frame."""

    s_m: Array
    """(N, T), 0 at the first pose"""
    ey_m: Array
    epsi_rad: Array


def onto_road(pose: Array, anchor: Anchor) -> RoadPose:
    """Poses (N, T, 3), columns X_m, Y_m and yaw_rad, in the frames of the anchored roads.

    Valid up to half of the circle ahead.
    """
    kappa, ey, epsi = (column[:, None] for column in anchor)
    moved = pose - pose[:, :1]
    turn = epsi - pose[:, :1, 2]
    along = np.cos(turn) * moved[..., 0] - np.sin(turn) * moved[..., 1]
    beside = np.sin(turn) * moved[..., 0] + np.cos(turn) * moved[..., 1] + ey
    place = project(along, beside, kappa)
    return RoadPose(place.s_m, place.ey_m, epsi + moved[..., 2] - place.turn_rad)


class Recording(NamedTuple):
    """Samples of E episodes, concatenated."""

    x: Array32
    """(T, n) states, or (T, n - 3) without the path states where there are poses"""
    u: Array32
    """(T, m) inputs, each held until the next sample; the last of an episode is not used"""
    w: Array32
    """(T, p) exogenous signals; with poses, the curvature that the episode was drawn for"""
    pose: Array
    """(T, 3) X_m, Y_m, yaw_rad on a plane, or (0, 3)"""
    first: NDArray[np.int64]
    """(E,) row at which each episode begins"""
    conditions: Array32 | None = None
    """(T, q) true road, wind, load and tyres of a simulated car, each held as the inputs; None: not
    known, or they do not vary"""

    @property
    def has_poses(self) -> bool:
        return len(self.pose) > 0

    @property
    def lengths(self) -> NDArray[np.int64]:
        """(E,) samples of each episode."""
        return np.diff(np.append(self.first, len(self.x)))


class Starts(NamedTuple):
    """First rows of windows, and their roads."""

    row: NDArray[np.int64]
    """(N,) row of the first state"""
    episode: NDArray[np.int32]
    """(N,)"""
    anchor: Anchor | None
    """pose on the road one period before the first state; None without poses"""

    def take(self, rows: Rows) -> "Starts":
        """The starts of these rows."""
        anchor = self.anchor and Anchor(*(column[rows] for column in self.anchor))
        return Starts(self.row[rows], self.episode[rows], anchor)


def cut(
    recording: Recording,
    starts: Starts,
    schema: Schema,
    roles: Roles,
    steps: int = STEPS,
    past_steps: int = PAST_STEPS,
) -> Trajectories:
    """The windows of `steps` steps from these starts, with the `past_steps` steps before them.

    Each start needs that many samples of its episode before it, and at least one with poses.
    """
    ahead = starts.row[:, None] + np.arange(steps + 1)
    before = starts.row[:, None] + np.arange(-past_steps, 0)
    states, inputs = past_columns(schema, roles)
    x, w = recording.x[ahead], recording.w[ahead[:, :-1]]
    if starts.anchor is not None:
        since = starts.row[:, None] + np.arange(-1, steps + 1)
        road = onto_road(recording.pose[since], starts.anchor)
        path = np.stack([np.diff(road.s_m), road.ey_m[:, 1:], road.epsi_rad[:, 1:]], axis=-1)
        x = np.concatenate([x, path.astype(np.float32)], axis=-1)
        curvature = starts.anchor.curvature_per_m[:, None, None].astype(np.float32)
        w = np.broadcast_to(curvature, (len(starts.row), steps, 1))
    past = np.concatenate([recording.x[before][..., states], recording.u[before][..., inputs]], -1)
    return Trajectories(x, recording.u[ahead[:, :-1]], w, past, starts.episode)


def possible_starts(
    recording: Recording, episodes: NDArray[np.integer], past_steps: int = PAST_STEPS
) -> NDArray[np.int64]:
    """Rows (M,) of these episodes with enough samples before and after them for a window."""
    lengths, least = recording.lengths, max(past_steps, int(recording.has_poses))
    rows = [
        recording.first[e] + np.arange(least, lengths[e] - STEPS)
        for e in episodes
        if lengths[e] > least + STEPS
    ]
    return np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)
