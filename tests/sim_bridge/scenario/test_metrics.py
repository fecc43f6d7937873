"""Figures of a drive, and the limits that judge it."""

from math import inf, isnan

import numpy as np
import pytest

from sim_bridge.scenario.courses import Course
from sim_bridge.scenario.metrics import LogRow, Metrics, judged, measure
from sim_bridge.scenario.speed import Stop

ROW = LogRow(0.0, 0.0, 0.0, 0.0, 0.0, 20.0, 0.0, 0.0, 0.0, 0.0, 0.0, 20.0, -1)


def test_errors_are_measured_against_the_reference() -> None:
    first = ROW._replace(ey_m=1.0, wanted_ey_m=0.9, vx_mps=19.0)
    last = ROW._replace(ey_m=-0.3, epsi_rad=0.02, wanted_epsi_rad=0.01, yaw_rate_radps=0.2)
    log = [first, last]
    metrics = measure(log, (), Course())
    assert metrics.ey_peak_m == pytest.approx(0.3)
    assert metrics.ey_rms_m == pytest.approx(np.sqrt((0.01 + 0.09) / 2))
    assert metrics.epsi_peak_rad == pytest.approx(0.01)
    assert metrics.speed_peak_mps == pytest.approx(1.0)
    assert metrics.lateral_peak_mps2 == pytest.approx(4.0)
    assert isnan(metrics.cone_hits)
    assert isnan(metrics.stop_error_m)


def test_a_hold_is_judged_by_its_place_and_its_movement() -> None:
    held = ROW._replace(stop=0.0, s_m=100.2, vx_mps=0.0)
    log = [ROW, held, held._replace(s_m=100.23, steer_rad=0.01), held, ROW]
    metrics = measure(log, (Stop(at_s_m=100.0, hold_s=1.0),), Course())
    assert metrics.stop_error_m == pytest.approx(0.2)
    assert metrics.creep_m == pytest.approx(0.03)
    assert metrics.hold_steer_rad == pytest.approx(0.01)
    assert metrics.stops_missed == 0.0


def test_a_stop_that_was_not_reached_is_missed() -> None:
    metrics = measure([ROW, ROW], (Stop(at_s_m=100.0),), Course())
    assert metrics.stop_error_m == inf
    assert metrics.stops_missed == 1.0
    assert isnan(metrics.creep_m)


def test_figures_are_judged_by_their_limits() -> None:
    metrics = Metrics(ey_peak_m=0.3, lane_margin_m=0.1, cone_hits=2.0)
    limits = {"ey_peak_m": 0.2, "lane_margin_m": 0.05, "creep_m": 1.0}
    figures = judged(metrics, ("cone_hits",), limits)
    assert [(figure.name, figure.is_kept) for figure in figures] == [
        ("ey_peak_m", False),
        ("creep_m", False),
        ("cone_hits", True),
        ("lane_margin_m", True),
    ]
    assert figures[0].text == "0.3 (limit 0.2, MISSED)"


def test_an_empty_drive_has_no_figures() -> None:
    assert all(map(isnan, measure([], (), Course())))
