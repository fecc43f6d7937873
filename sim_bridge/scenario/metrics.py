"""Figures of a drive, measured at the car, and the limits that they are judged by."""

from collections.abc import Mapping, Sequence
from math import inf, nan
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.drive.scenario import CarFigure
from sim_bridge.scenario.courses import Course, Poses, cone_hits, lane_margin_m, road_margin_m
from sim_bridge.scenario.speed import STOP_WINDOW_M, Stop
from sim_bridge.scenario.table import Table


class Metrics(NamedTuple):
    """Figures of one drive; NaN where a figure does not apply."""

    ey_rms_m: float = nan
    """lateral deviation from the wanted position"""
    ey_peak_m: float = nan
    epsi_rms_rad: float = nan
    """heading against the wanted path"""
    epsi_peak_rad: float = nan
    speed_rms_mps: float = nan
    """speed against the wanted one"""
    speed_peak_mps: float = nan
    lateral_peak_mps2: float = nan
    """speed times yaw rate"""
    sideslip_peak_rad: float = nan
    """above `SLIDING_MPS`"""
    steer_peak_rad: float = nan
    """of the steering wheel, as commanded and applied"""
    stop_error_m: float = nan
    """largest distance of a stop from its target; inf if the car was not held for a stop"""
    creep_m: float = nan
    """largest change of arc length while the car was held"""
    hold_steer_rad: float = nan
    """largest change of the steering wheel, as commanded and applied, while the car was held"""
    stops_missed: float = nan
    """stops whose target was passed by more than `STOP_WINDOW_M`, or not reached"""
    cone_hits: float = nan
    lane_margin_m: float = nan
    """smallest distance of the body to an edge of a lane of the course; negative: outside"""
    road_margin_m: float = nan
    """smallest distance of the body to an edge of the road, where its width is given"""


SLIDING_MPS = 5.0
"""speed above which sideslip is measured"""
HIGHER_IS_BETTER = frozenset({"lane_margin_m", "road_margin_m"})


def judged(
    metrics: Metrics, names: Sequence[str], limits: Mapping[str, float]
) -> tuple[CarFigure, ...]:
    """The named figures and those with a limit, in the order of `Metrics`.

    A figure that does not apply keeps no limit.
    """
    figures = []
    for name, value in metrics._asdict().items():
        limit = limits.get(name)
        if name in names or limit is not None:
            is_kept = limit is None or (
                value >= limit if name in HIGHER_IS_BETTER else value <= limit
            )
            figures.append(CarFigure(name, value, limit, is_kept))
    return tuple(figures)


class LogRow(NamedTuple):
    """One period of a drive, for the figures."""

    time_s: float
    s_m: float
    ey_m: float
    epsi_rad: float
    curvature_per_m: float
    vx_mps: float
    vy_mps: float
    yaw_rate_radps: float
    steer_rad: float
    wanted_ey_m: float
    wanted_epsi_rad: float
    wanted_mps: float
    stop: float
    """number of the stop where the car is held; -1: none"""


def measure(
    rows: Sequence[LogRow], stops: Sequence[Stop], course: Course, road_width_m: Table | None = None
) -> Metrics:
    """The figures of a drive."""
    if not rows:
        return Metrics()
    columns = [(name, float) for name in LogRow._fields]
    log = np.rec.fromarrays(list(np.array(rows).T), columns)
    fast = log.vx_mps > SLIDING_MPS
    slip = np.abs(np.arctan2(log.vy_mps[fast], log.vx_mps[fast]))
    poses = Poses(log.s_m, log.ey_m, log.epsi_rad, log.curvature_per_m)
    holds = [np.flatnonzero(log.stop == k) for k in range(len(stops))]
    errors_m = [
        abs(float(poses.s_m[hold[0]]) - stop.at_s_m) if len(hold) else inf
        for hold, stop in zip(holds, stops, strict=True)
    ]
    missed = float(sum(error_m > STOP_WINDOW_M for error_m in errors_m))
    margin_m = lane_margin_m(course, poses)

    def largest_span(values: Array) -> float:
        """Largest range over one hold; NaN if there was none."""
        return max((float(np.ptp(values[hold])) for hold in holds if len(hold)), default=nan)

    return Metrics(
        ey_rms_m=rms(log.ey_m - log.wanted_ey_m),
        ey_peak_m=peak(log.ey_m - log.wanted_ey_m),
        epsi_rms_rad=rms(log.epsi_rad - log.wanted_epsi_rad),
        epsi_peak_rad=peak(log.epsi_rad - log.wanted_epsi_rad),
        speed_rms_mps=rms(log.vx_mps - log.wanted_mps),
        speed_peak_mps=peak(log.vx_mps - log.wanted_mps),
        lateral_peak_mps2=peak(log.vx_mps * log.yaw_rate_radps),
        sideslip_peak_rad=float(slip.max()) if len(slip) else nan,
        steer_peak_rad=peak(log.steer_rad),
        stop_error_m=max(errors_m, default=nan),
        creep_m=largest_span(poses.s_m),
        hold_steer_rad=largest_span(log.steer_rad),
        stops_missed=missed if stops else nan,
        cone_hits=float(cone_hits(course, poses)) if course.cones else nan,
        lane_margin_m=nan if margin_m == inf else margin_m,
        road_margin_m=nan
        if road_width_m is None
        else road_margin_m(course.body, poses, road_width_m),
    )


def rms(values: Array) -> float:
    """Root of the mean square; 0 of no values."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def peak(values: Array) -> float:
    """Largest magnitude; 0 of no values."""
    return float(np.max(np.abs(values), initial=0.0))
