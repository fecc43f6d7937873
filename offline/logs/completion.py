"""Signals of the controller that logs lack, from those that they have.

Lateral speed by `offline.logs.lateral_speed`; yaw rate from the heading, heading from the course,
and without a pose the path of a car that moves so from the origin.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import savgol_filter

from offline.logs.episode import LogEpisode
from offline.logs.lateral_speed import (
    STANDING_MPS,
    SmoothedSpeed,
    Way,
    by_acceleration,
    by_pose,
    by_yaw_rate,
)
from offline.logs.mapping import LogMapping
from offline.logs.pieces import MeasuredMotion, cut_pieces
from offline.logs.signal import LoggedDrive
from rt_controller.contract.arrays import Array
from rt_controller.contract.car import UNNAMED_CAR, Car
from rt_controller.mapping.lateral_speed import RearAxle
from rt_controller.mapping.quantity import Quantity

VX, VY, YAW_RATE = "vx_mps", "vy_mps", "yaw_rate_radps"
CONSTANTS = ("rear_axle_m", "rear_slip_s2_per_m", "yaw_inertia_m")
"""of the equation of the rear axle, as [car] has them"""
_SLOPE_S = 0.25
"""window in which a heading is a parabola"""
LEAST_INERTIA_M = 0.01
"""a smaller `yaw_inertia_m` is no car's: it is about as long as `rear_axle_m`"""
_UNKNOWN_M = 0.15
"""standard deviation of the place of the rear axle if [car] does not give it"""


class Accuracy(NamedTuple):
    """How the lateral speed of a data set was estimated, and how exact it is."""

    way: Way
    std_mps: float
    """root mean square of the standard deviation of the moving car"""
    rms_mps: float | None
    """of the difference to a measured lateral speed in [checks.signals]; None: there is none"""
    car: Car
    """with the constants of the estimate"""

    def figures(self) -> dict[str, object]:
        """The same for `--json`."""
        own = {"way": str(self.way), "std_mps": self.std_mps, "rms_mps": self.rms_mps}
        return own | {name: getattr(self.car, name) for name in CONSTANTS}

    def sentences(self, is_of_mapping: bool) -> str:
        """What was done, and the table for the mapping."""
        against = ""
        if self.rms_mps is not None:
            against = f", {self.rms_mps:.3f} m/s root mean square from the measured one"
        names = CONSTANTS if is_of_mapping else ("wheelbase_m", "steering_ratio", *CONSTANTS)
        rows = "".join(f"\n{name} = {getattr(self.car, name):.4g}" for name in names)
        default = "" if is_of_mapping else " (without [car]: geometry of the default car)"
        wrong, inertia_m = "", self.car.yaw_inertia_m
        if inertia_m is not None and inertia_m < LEAST_INERTIA_M:
            wrong = (
                "\nnote: no car has a yaw_inertia_m of nearly 0, so this v_y may be wrong. Check "
                "ahead_m, left_m and the heading in [pose], delay_s, and [car]."
            )
        return (
            f"v_y is not in the logs: estimated from {self.way}{default}, standard deviation "
            f"{self.std_mps:.3f} m/s{against}. rt-controller estimates it with the same constants, "
            f"which models of this data set carry; for the mapping of the car:\n[car]{rows}{wrong}"
        )


def complete(
    sampled: Sequence[Sequence[LogEpisode]], drives: Sequence[LoggedDrive], mapping: LogMapping
) -> tuple[list[list[LogEpisode]], Accuracy]:
    """The stretches of each drive with v_y and pose, and how exact that v_y is."""
    car = mapping.car.car if mapping.car else UNNAMED_CAR
    flat = [part for parts in sampled for part in parts]
    motions = [
        _motion(part, number, mapping, car)
        for number, parts in enumerate(sampled)
        for part in parts
    ]
    estimate = _estimate(motions, drives, mapping, car)
    completed = [
        _completed(part, motion, estimate, i, mapping)
        for i, (part, motion) in enumerate(zip(flat, motions, strict=True))
    ]
    is_moving = np.concatenate([motion.vx_mps for motion in motions]) >= STANDING_MPS
    std = np.concatenate(estimate.std_mps)[is_moving]
    measured = next(
        (n for n in mapping.checks.signals if mapping.quantity(n) is Quantity.LATERAL_SPEED), None
    )
    rms = None
    if measured:
        known = np.concatenate([part.signals[measured].to_numpy() for part in flat])
        rms = float(np.sqrt(np.mean((np.concatenate(estimate.vy_mps) - known) ** 2)))
    axle = estimate.axle
    own = replace(
        car,
        rear_axle_m=car.rear_axle_m if mapping.car else axle.rear_axle_m,
        rear_slip_s2_per_m=float(np.clip(axle.slip_s2_per_m, 1e-4, 0.05)),
        yaw_inertia_m=float(np.clip(axle.inertia_m, 0.0, 10.0)),
    )
    accuracy = Accuracy(estimate.way, float(np.sqrt(np.mean(std**2))), rms, own)
    counts = np.cumsum([0, *map(len, sampled)])
    parts = [completed[a:b] for a, b in pairwise(counts)]
    return parts, accuracy


def _motion(part: LogEpisode, log: int, mapping: LogMapping, car: Car) -> MeasuredMotion:
    signals = part.signals
    pose = part.pose.copy() if mapping.pose else None
    if YAW_RATE in signals:
        rate = signals[YAW_RATE].to_numpy()
    else:
        rate = _slope(part.pose[:, 2], mapping.period_s)
        rate = np.where(signals[VX] < STANDING_MPS, 0.0, rate)
    ay = next((n for n in signals if mapping.quantity(n) is Quantity.LATERAL_ACCELERATION), None)
    steer = mapping.name_of(Quantity.STEERING)
    ratio = 1.0 if steer and steer.startswith("road_wheel") else car.steering_ratio
    return MeasuredMotion(
        log,
        signals[VX].to_numpy(),
        rate,
        pose,
        None if ay is None else signals[ay].to_numpy(),
        None if steer is None else signals[steer].to_numpy() / ratio,
    )


def _slope(values: Array, period_s: float) -> Array:
    """Slope (T,) of a parabola through the window around each sample."""
    width = min(2 * round(0.5 * _SLOPE_S / period_s) + 1, len(values) - 1 + len(values) % 2)
    if width < 3:
        return np.zeros_like(values)
    return np.asarray(savgol_filter(values, width, 2, deriv=1, delta=period_s))


def _estimate(
    motions: Sequence[MeasuredMotion], drives: Sequence[LoggedDrive], mapping: LogMapping, car: Car
) -> SmoothedSpeed:
    """By the first way that all logs have the signals for."""
    known = mapping.car
    tau, q = (known.rear_slip_s2_per_m, known.yaw_inertia_m) if known else (None, None)
    b = car.rear_axle_m
    prior = RearAxle(b, tau or 0.005, 0.85 * b if q is None else q)
    spread = np.array([0.03 if known else _UNKNOWN_M, 3e-3, 0.4])
    if tau is not None:
        spread[1:] = 0.1 * tau, 0.1
    pieces = cut_pieces(motions, mapping.period_s)
    if pieces.pose is not None:
        step_s = max(signal.usual_step_s for drive in drives for signal in drive.poses)
        every = max(1, round(step_s / mapping.period_s))
        return by_pose(pieces, pieces.pose, prior, spread, every)
    if pieces.ay is not None:
        return by_acceleration(pieces, pieces.ay, prior, spread)
    return by_yaw_rate(
        pieces, pieces.wheel if tau is None else None, prior, spread, car.wheelbase_m
    )


def _completed(
    part: LogEpisode, motion: MeasuredMotion, estimate: SmoothedSpeed, i: int, mapping: LogMapping
) -> LogEpisode:
    vx, vy, rate = motion.vx_mps, estimate.vy_mps[i], motion.yaw_rate
    signals = part.signals.assign(**{VY: vy, YAW_RATE: rate})
    pose = part.pose
    if motion.pose is not None and not np.isfinite(pose[:, 2]).all():
        pose = np.column_stack([pose[:, :2], estimate.yaw_rad[i]])
    elif motion.pose is None and mapping.places_roads:
        dt = mapping.period_s
        yaw = cumulative_trapezoid(rate, dx=dt, initial=0.0)
        east, north = vx * np.cos(yaw) - vy * np.sin(yaw), vx * np.sin(yaw) + vy * np.cos(yaw)
        x, y = (cumulative_trapezoid(each, dx=dt, initial=0.0) for each in (east, north))
        pose = np.column_stack([x, y, yaw])
    return replace(part, signals=signals, pose=pose)
