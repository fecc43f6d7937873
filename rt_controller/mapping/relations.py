"""Relations between the signals of a car that hold for every car, and which a log contradicts.

`signals check` and `offline-import` judge by them.
Integrals and changes over windows are compared, not derivatives, so that noise has little effect.
Expected and found are compared by the sum of their products over the larger sum of squares: 1 if
equal, 1/f for a factor f either way, 0 if unrelated, negative for opposite signs.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from math import nan
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import (
    DEFAULT_GEOMETRY,
    UNDERSTEER_RAD_PER_MPS2,
    SteeringGeometry,
)

STEP_S, SHORT, MIDDLE, LONG = 0.05, 12, 20, 40
"""windows begin every 50 ms and are 0.6 s, 1 s or 2 s long"""
LONGEST_GAP_S, LONGEST_LOG_S = 0.5, 4.0 * 3600.0
"""shorter gaps are interpolated; of a longer log, or one whose clock was set, the end counts"""
LEAST_WINDOWS, LEAST_SPEED_MPS, LEAST_CORRELATION = 20, 3.0, 0.8
JUMP, JUMP_RAD, JUMP_M = 10.0, 0.2, 0.5
"""a step beyond 10 times the 90th percentile and beyond these is no motion, but another lane"""
NOT_COMPARED, CONTRADICTED, HOLDS = "not compared: ", "yes", "no"
HELP = (
    "A wrong column, unit, factor or sign of one signal contradicts in every relation that it is "
    "part of (of the wheel also a wrong geometry in [car]): correct the signal that all of them "
    "share first"
)

Track = Sequence[tuple[float, float]] | Array
"""time in s and SI value (N, 2), of one signal"""
Signals = Mapping[str, Array]
"""values (N,) on a grid of `STEP_S`, by slot; NaN where there are none"""

VX, VY, YAW_RATE = "states.vx_mps", "states.vy_mps", "states.yaw_rate_radps"
OFFSET, HEADING, CURVATURE = "states.ey_m", "states.epsi_rad", "exogenous.curvature_per_m"
X, Y, YAW = "pose.x", "pose.y", "pose.yaw"
WHEEL, COMMANDED = "inputs.steer_rad", "commands.steer_rad"
ENGAGE, CAR_BRAKES = "mission.engage", "mission.car_brakes"
TURN_OF_POSE, SPEED_OF_POSE = "slope of pose.yaw = yaw rate", "speed of the pose = v_x"
COURSE_OF_POSE = "direction of motion of the pose = pose.yaw"


class Relation(NamedTuple):
    """What is expected and what is found of mapped signals."""

    text: str
    needs: tuple[str, ...]
    """slots; the relation is left out if one is not mapped"""
    windows: Callable[[Signals], tuple[Array, Array]]
    """expected and found in each window"""
    least: float
    """a window with less of both has too little motion"""
    least_agreement: float = 0.67
    """a factor of 1.5 either way; mph for km/h is 1.6"""
    unrelated: str = ""
    """why two that are not related are not compared; empty: they contradict each other"""


class Comparison(NamedTuple):
    """Whether a relation is contradicted."""

    answer: str
    """ "yes, …", "no", "not compared: …" """
    factor: float = nan
    """found over expected; NaN: not compared, not related, or different in a part only"""

    @property
    def is_contradicted(self) -> bool:
        """True for "yes, …"."""
        return self.answer.startswith(CONTRADICTED)


def check_relations(
    tracks: Mapping[str, Track], relations: Iterable[Relation]
) -> dict[str, Comparison]:
    """Whether usable samples, by slot, contradict relations, by the text of each one.

    A relation with a slot that is not mapped is left out.
    """
    signals, answers = on_grid(tracks), {}
    for relation in relations:
        if all(name in tracks for name in relation.needs):
            empty = ", ".join(name for name in relation.needs if not len(tracks[name]))
            absent = Comparison(f"{NOT_COMPARED}no samples of {empty}")
            answers[relation.text] = absent if empty else _compare(relation, signals)
    return answers


def on_grid(tracks: Mapping[str, Track]) -> dict[str, Array]:
    """Values (N,) of each track every `STEP_S`; NaN in gaps, and of v_x if the car is slow."""
    arrays = {name: np.reshape(track, (-1, 2)) for name, track in tracks.items()}
    ends_s = [end for each in arrays.values() for end in (*each[:1, 0], *each[-1:, 0])] or [0.0]
    start_s = max(min(ends_s), max(ends_s) - LONGEST_LOG_S)
    times_s = np.arange(start_s, max(ends_s) + STEP_S, STEP_S)
    signals = {name: _resampled(each, times_s, name == YAW) for name, each in arrays.items()}
    if VX in signals:  # At rest the course has no angle.
        signals[VX][~(np.abs(signals[VX]) > LEAST_SPEED_MPS)] = np.nan
    return signals


def relations_of(geometry: SteeringGeometry | None) -> tuple[Relation, ...]:
    """The relations of a car; None: its geometry is not known, that of the default car counts."""
    geometry = geometry or DEFAULT_GEOMETRY
    motion, place = (VX, YAW_RATE), (HEADING, CURVATURE, VX, YAW_RATE)
    wheels = tuple(
        Relation(
            f"{name} = wheel angle of the yaw rate",
            (name, *motion),
            partial(_steering, name, geometry),
            0.03,
            0.4,
            unrelated,
        )
        for name, unrelated in ((WHEEL, ""), (COMMANDED, "commands that are not followed"))
    )
    return (
        Relation("v_x * yaw rate is at most 15 m/s^2", motion, _lateral, 0.0, 0.95),
        Relation(TURN_OF_POSE, (YAW, *motion), _turn_of_pose, 0.02, 0.87),
        Relation(SPEED_OF_POSE, (X, Y, VX), _speed_of_pose, LEAST_SPEED_MPS, 0.87),
        # 0.94: cos(20 deg) between heading and direction of motion
        Relation(COURSE_OF_POSE, (X, Y, YAW), _course, 3.0, 0.94),
        Relation("curvature_per_m = yaw rate / v_x", place, _curvature, 0.08, 0.5),
        Relation("slope of epsi_rad = yaw rate - curvature * v_x", place, _heading, 0.02),
        Relation(
            "slope of ey_m = v_x sin(e_psi) + v_y cos(e_psi)",
            (OFFSET, HEADING, *motion),
            _offset,
            0.1,
        ),
        Relation("sign of vy_mps", (VY, OFFSET, HEADING, VX), _drift, 0.08, 0.0),
        *wheels,
    )


def _compare(relation: Relation, signals: Signals) -> Comparison:
    """Compare with the delay of the largest correlation."""
    expected, found = relation.windows(signals)
    best, agreement, factor, n_windows = -1.0, 0.0, 0.0, 0
    for delay in range(-6, 7):
        n = max(len(expected) - abs(delay), 0)
        x, y = expected[max(-delay, 0) :][:n], found[max(delay, 0) :][:n]
        # Three times the least motion are a change that is not expected and no noise.
        moving = np.maximum(np.abs(x), np.abs(y) / 3.0) > relation.least  # NaN: False
        x, y = x[moving], y[moving]
        xx, yy, xy = float(x @ x), float(y @ y), float(x @ y)
        correlation = abs(xy) / max((xx * yy) ** 0.5, 1e-12)
        if correlation > best:
            best, agreement, n_windows = correlation, xy / max(xx, yy, 1e-12), len(x)
            factor = xy / max(xx, 1e-12)
    if n_windows < LEAST_WINDOWS:
        return Comparison(f"{NOT_COMPARED}too little motion")
    if relation.unrelated and best < LEAST_CORRELATION:
        return Comparison(f"{NOT_COMPARED}{relation.unrelated}")
    if agreement >= relation.least_agreement:
        return Comparison(HOLDS, factor)
    if best < LEAST_CORRELATION:
        return Comparison(f"{CONTRADICTED}, the two are not related (correlation {best:.2f})")
    if relation.least_agreement < factor < 1.0 / relation.least_agreement:
        return Comparison(f"{CONTRADICTED}, in a part of the log only; the car may stand there")
    hint = "; try sign = -1, or remove it" if factor < 0.0 else ""
    return Comparison(f"{CONTRADICTED}, {factor:.3g} times as expected{hint}", factor)


def _lateral(s: Signals) -> tuple[Array, Array]:
    lateral = s[VX] * s[YAW_RATE]
    return lateral, np.clip(lateral, -15.0, 15.0)


def _turn_of_pose(s: Signals) -> tuple[Array, Array]:
    moving = 0.0 * s[VX]  # NaN of a slow car
    return changes(s[YAW] + moving, MIDDLE, JUMP_RAD), integrals(s[YAW_RATE], MIDDLE)


def _speed_of_pose(s: Signals) -> tuple[Array, Array]:
    return np.hypot(*_moved(s)), integrals(s[VX], MIDDLE)


def _course(s: Signals) -> tuple[Array, Array]:
    """Way of the pose in a window, and its part in the direction of the heading."""
    dx, dy = _moved(s)
    yaw = s[YAW][MIDDLE // 2 :][: len(dx)]
    return np.hypot(dx, dy), dx * np.cos(yaw) + dy * np.sin(yaw)


def _moved(s: Signals) -> tuple[Array, Array]:
    return changes(s[X], MIDDLE, JUMP_M), changes(s[Y], MIDDLE, JUMP_M)


def _curvature(s: Signals) -> tuple[Array, Array]:
    turned, road = integrals(s[YAW_RATE], LONG), integrals(s[CURVATURE] * s[VX], LONG)
    most_rad = 0.3 * np.maximum(np.abs(turned), np.abs(road))  # of a car that follows the road
    is_steady = np.abs(changes(s[HEADING], LONG, JUMP_RAD)) < most_rad
    return np.where(is_steady, turned, np.nan), road


def _heading(s: Signals) -> tuple[Array, Array]:
    turned = integrals(s[YAW_RATE] - s[CURVATURE] * s[VX], SHORT)
    return centred(turned), centred(changes(s[HEADING], SHORT, JUMP_RAD))


def _offset(s: Signals) -> tuple[Array, Array]:
    """Without v_y: that of the default car in a steady turn, with the slip of its rear axle."""
    rear_slip_s2_per_m = 0.005
    steady = (DEFAULT_GEOMETRY.rear_axle_m - rear_slip_s2_per_m * s[VX] ** 2) * s[YAW_RATE]
    course = centred(s[HEADING] + s.get(VY, steady) / s[VX])
    return integrals(s[VX] * course, MIDDLE), centred(changes(s[OFFSET], MIDDLE, JUMP_M))


def _drift(s: Signals) -> tuple[Array, Array]:
    ahead = integrals(s[VX] * centred(s[HEADING]), MIDDLE)
    rest = centred(changes(s[OFFSET], MIDDLE, JUMP_M) - ahead)
    return centred(integrals(s[VY], MIDDLE)), rest


def _steering(name: str, geometry: SteeringGeometry, s: Signals) -> tuple[Array, Array]:
    """Commands count only while the car follows them."""
    wheel = s[name]
    if name == COMMANDED:
        follows = (s.get(ENGAGE, np.ones(1)) > 0.5) & ~(s.get(CAR_BRAKES, np.zeros(1)) > 0.5)
        wheel = np.where(follows, wheel, np.nan)
    length_m = geometry.wheelbase_m + UNDERSTEER_RAD_PER_MPS2 * s[VX] ** 2
    turned = wheel * s[VX] / (geometry.steering_ratio * length_m)
    return integrals(s[YAW_RATE], SHORT), integrals(turned, SHORT)


def _resampled(track: Array, times_s: Array, is_angle: bool) -> Array:
    """Values (N,) at the times, NaN outside of the track and in its gaps."""
    if len(track) < 2:
        return np.full(len(times_s), np.nan)
    sampled_s, values = track[np.argsort(track[:, 0], kind="stable")].T
    values = np.unwrap(values) if is_angle else values
    found: Array = np.interp(times_s, sampled_s, values, left=np.nan, right=np.nan)
    after = np.clip(np.searchsorted(sampled_s, times_s), 1, len(sampled_s) - 1)
    found[sampled_s[after] - sampled_s[after - 1] > LONGEST_GAP_S] = np.nan
    return found


def integrals(values: Array, steps: int) -> Array:
    """Integral (N - steps,) over each window."""
    return _sums(0.5 * STEP_S * (values[1:] + values[:-1]), steps)


def changes(values: Array, steps: int, least_jump: float) -> Array:
    """Change (N - steps,) over each window, NaN where the signal jumps."""
    step = np.diff(values)
    size = np.abs(step[np.isfinite(step)])
    if size.size:
        step[np.abs(step) > max(JUMP * np.percentile(size, 90.0), least_jump)] = np.nan
    return _sums(step, steps)


def _sums(values: Array, steps: int) -> Array:
    return np.convolve(values, np.ones(steps), "valid") if len(values) >= steps else np.empty(0)


def centred(values: Array) -> Array:
    """Without the median, which is that of a constant bias of a sensor."""
    known = values[np.isfinite(values)]
    return values - np.median(known) if known.size else values
