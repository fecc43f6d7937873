"""One figure for each test, with the targets of its lines in it."""

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sim_bridge.plant.parameters import GRAVITY_MPS2
from sim_bridge.validation import dwell as dwell_test
from sim_bridge.validation.acceptance import Verdict, line_of, target_of
from sim_bridge.validation.cornering import Cornering
from sim_bridge.validation.lane_change import CORNERS_M, LaneChange
from sim_bridge.validation.longitudinal import HUNDRED_MPS, Longitudinal, rim_mps
from sim_bridge.validation.peer import Pair
from sim_bridge.validation.run import Array
from sim_bridge.validation.transients import Transients

BLUE, ORANGE, GREEN, RED, GREY = "#2f6fb3", "#d9822b", "#3c9d6b", "#c0392b", "#8a97a5"
_SERIES = (BLUE, ORANGE, GREEN, "#7b5ea7", RED, "#4b9fb5", "#a0713b")
_TARGET = {"color": "#52606d", "dash": "dash", "width": 1.4}


def cornering(found: Cornering, lines: Sequence[Verdict]) -> go.Figure:
    """Steering wheel angle, roll and sideslip over lateral acceleration, with the slopes' targets.

    A target is drawn through the point where the car has 0.05 g: it is about the slope.
    """
    run = found.run
    figure = _canvas(1, 3, 340)
    curves = (
        ("steering wheel angle / deg", run.steer_deg, "steering effort"),
        ("roll / deg", run.roll_deg, "roll"),
        ("sideslip / deg", run.sideslip_deg, "sideslip"),
    )
    for column, (title, angle_deg, line) in enumerate(curves, 1):
        target_degpg = target_of(lines, line)
        start_deg = float(np.interp(0.05, run.lateral_g, angle_deg)) - 0.05 * target_degpg
        _line(figure, 1, column, run.lateral_g, angle_deg, BLUE, "car", column == 1)
        _target(figure, 1, column, (0.0, 0.4), (start_deg, start_deg + 0.4 * target_degpg),
                column == 1)  # fmt: skip
        _axes(figure, 1, column, "lateral acceleration / g", title)
    _marker(figure, 1, 1, 0.3, target_of(lines, "steering wheel angle at 0.3 g"))
    return figure


def lane_change(found: LaneChange, lines: Sequence[Verdict]) -> go.Figure:
    """The way, the steering wheel and the four judged signals."""
    run = found.run
    figure = _canvas(3, 2, 780)
    corners_m = np.vstack(((0.0, 0.0), CORNERS_M, (run.pose[-1, 0], 0.0)))
    _line(figure, 1, 1, run.pose[:, 0], run.pose[:, 1], BLUE, "car", True)
    _line(figure, 1, 1, corners_m[:, 0], corners_m[:, 1], GREY, "path", True)
    _axes(figure, 1, 1, "way ahead / m", "way to the left / m")
    panels = (
        (1, 2, "steering wheel / deg", run.steer_deg, "steering wheel to the right"),
        (1, 2, "steering wheel / deg", run.steer_deg, "steering wheel to the left"),
        (2, 1, "lateral acceleration / g", run.lateral_g, "peak lateral acceleration"),
        (2, 2, "yaw rate / (deg/s)", run.yaw_rate_degps, "peak yaw rate"),
        (3, 1, "sideslip / deg", run.sideslip_deg, "peak sideslip"),
        (3, 2, "roll / deg", run.roll_deg, "peak roll"),
    )
    for row, column, title, signal, line in panels:
        target = target_of(lines, line)
        both_sides = (target, -target) if line.startswith("peak") else (target,)
        _line(figure, row, column, run.time_s, signal, BLUE, "car", False)
        for level in both_sides:
            _target(figure, row, column, (0.0, run.time_s[-1]), (level, level),
                    line == "peak roll" and level > 0.0)  # fmt: skip
        _axes(figure, row, column, "time / s", title)
    return figure


def cross_check(pairs: Sequence[Pair]) -> go.Figure:
    """Yaw rate and roll of both cars."""
    figure = _canvas(1, 2, 400)
    for index, pair in enumerate(pairs):
        for column, title, ours, theirs in (
            (1, "yaw rate / (deg/s)", pair.ours.yaw_rate_degps, pair.theirs.yaw_rate_degps),
            (2, "roll / deg", pair.ours.roll_deg, pair.theirs.roll_deg),
        ):
            named = index == 0 and column == 1
            _line(figure, 1, column, pair.ours.time_s, ours, BLUE, "this plant", named)
            _target(figure, 1, column, pair.theirs.time_s[::10], theirs[::10], named,
                    "commonroad-vehicle-models")  # fmt: skip
            _axes(figure, 1, column, "time / s", title)
    return figure


def steps(found: Transients, lines: Sequence[Verdict]) -> go.Figure:
    """Step steer at both speeds; a dot at 90 % of the steady value."""
    figure = _canvas(1, 3, 360)
    for step, color in zip(found.steps, _SERIES, strict=False):
        run = step.run
        label = f"{3.6 * run.speed_mps[0]:.0f} km/h"
        _line(figure, 1, 1, run.time_s, run.steer_deg, color, label, True)
        for column, signal, response in (
            (2, run.yaw_rate_degps, step.yaw_rate),
            (3, run.seen("ay_mps2"), step.lateral),
        ):
            _line(figure, 1, column, run.time_s, signal, color, label, False)
            _dots(figure, 1, column, [step.step_s + response.t90_s], [0.9 * response.steady], color)
    level_mps2 = target_of(lines, "steady lateral acceleration, 80 km/h")
    duration_s = found.steps[0].run.time_s[-1]
    _target(figure, 1, 3, (0.0, duration_s), (level_mps2, level_mps2), True)
    _axes(figure, 1, 1, "time / s", "steering wheel / deg")
    _axes(figure, 1, 2, "time / s", "yaw rate / (deg/s)")
    _axes(figure, 1, 3, "time / s", "lateral acceleration / (m/s²)")
    return figure


def frequency(found: Transients) -> go.Figure:
    """Gain and phase of yaw rate and lateral acceleration against the steering wheel."""
    figure = _canvas(2, 2, 560)
    for column, response, title in (
        (1, found.yaw_rate, "yaw rate gain / (1/s)"),
        (2, found.lateral, "lateral gain / (g/100 deg)"),
    ):
        _line(figure, 1, column, response.frequency_hz, response.gain, BLUE, "car", False)
        _dots(figure, 1, column, response.frequency_hz, response.gain, BLUE)
        _line(figure, 2, column, response.frequency_hz, response.phase_deg, BLUE, "car", False)
        _dots(figure, 2, column, response.frequency_hz, response.phase_deg, BLUE)
        _axes(figure, 1, column, "frequency / Hz", title)
        _axes(figure, 2, column, "frequency / Hz", "phase / deg")
        figure.update_yaxes(rangemode="tozero", row=1, col=column)
    return figure


def dwell(found: dwell_test.DwellSeries, lines: Sequence[Verdict]) -> go.Figure:
    """Steering wheel, yaw rate over its peak, and the way aside, for every amplitude."""
    figure = _canvas(1, 3, 400)
    for one, color in zip(found.runs, _SERIES, strict=False):
        run = one.run
        share = -100.0 * run.yaw_rate_degps / one.second_peak_degps
        label = f"{one.amplitude_deg:.0f} deg"
        _line(figure, 1, 1, run.time_s, run.steer_deg, color, label, True)
        _line(figure, 1, 2, run.time_s, share, color, label, False)
        _line(figure, 1, 3, run.time_s, run.pose[:, 1], color, label, False)
    for after_s in (1.0, 1.75):
        limit = target_of(lines, f"yaw rate left {after_s:.2f} s after")
        _marker(figure, 1, 2, dwell_test.END_S + after_s, limit)
    displaced_s = dwell_test.START_S + dwell_test.DISPLACED_AFTER_S
    _marker(figure, 1, 3, displaced_s, target_of(lines, "way aside after 1.07 s"))
    _axes(figure, 1, 1, "time / s", "steering wheel / deg")
    _axes(figure, 1, 2, "time / s", "yaw rate / % of its second peak")
    _axes(figure, 1, 3, "time / s", "way to the left / m")
    return figure


def braking(found: Longitudinal, lines: Sequence[Verdict]) -> go.Figure:
    """Speed, wheel speeds and deceleration."""
    run = found.braking
    figure = _canvas(1, 2, 360)
    rims_kmh = 3.6 * rim_mps(run)
    _line(figure, 1, 1, run.time_s, 3.6 * run.speed_mps, BLUE, "car", True)
    _line(figure, 1, 1, run.time_s, rims_kmh[:, 0], ORANGE, "front wheel", True)
    _line(figure, 1, 1, run.time_s, rims_kmh[:, 2], GREEN, "rear wheel", True)
    _line(figure, 1, 2, run.time_s, -run.seen("ax_mps2") / GRAVITY_MPS2, BLUE, "car", False)
    level_g = target_of(lines, "deceleration with 150 N")
    _target(figure, 1, 2, (0.0, run.time_s[-1]), (level_g, level_g), True)
    _axes(figure, 1, 1, "time / s", "speed / (km/h)")
    _axes(figure, 1, 2, "time / s", "deceleration / g")
    return figure


def driving_off(found: Longitudinal, lines: Sequence[Verdict]) -> go.Figure:
    """Speed with the span of the target in it, gear, and engine speed."""
    run = found.driving_off
    figure = _canvas(1, 3, 360)
    _line(figure, 1, 1, run.time_s, 3.6 * run.speed_mps, BLUE, "car", False)
    wanted = line_of(lines, "0-100 km/h")
    if wanted.low is not None and wanted.high is not None:
        _target(figure, 1, 1, (wanted.low, wanted.high), (3.6 * HUNDRED_MPS, 3.6 * HUNDRED_MPS),
                True, width=5.0)  # fmt: skip
    _line(figure, 1, 2, run.time_s, run.seen("gear"), BLUE, "car", False)
    _line(figure, 1, 3, run.time_s, run.seen("engine_rpm"), BLUE, "car", False)
    _axes(figure, 1, 1, "time / s", "speed / (km/h)")
    _axes(figure, 1, 2, "time / s", "gear")
    _axes(figure, 1, 3, "time / s", "engine speed / rpm")
    return figure


def _canvas(rows: int, columns: int, height: int) -> go.Figure:
    figure = make_subplots(
        rows, columns, horizontal_spacing=0.24 / columns, vertical_spacing=0.28 / rows
    )
    figure.update_layout(
        template="plotly_white",
        height=height,
        margin={"l": 60, "r": 20, "t": 40, "b": 50},
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
        font={"family": "system-ui, sans-serif", "size": 13, "color": "#1f2933"},
    )
    return figure


def _axes(figure: go.Figure, row: int, column: int, x: str, y: str) -> None:
    figure.update_xaxes(title={"text": x, "standoff": 6}, row=row, col=column)
    figure.update_yaxes(title={"text": y, "standoff": 6}, row=row, col=column)


def _line(
    figure: go.Figure, row: int, column: int, x: Array, y: Array, color: str, name: str,
    named: bool,
) -> None:  # fmt: skip
    figure.add_trace(
        go.Scatter(x=x, y=y, mode="lines", line={"color": color, "width": 1.8}, name=name,
                   legendgroup=name, showlegend=named),
        row=row, col=column,
    )  # fmt: skip


def _target(
    figure: go.Figure, row: int, column: int, x: Sequence[float] | Array,
    y: Sequence[float] | Array, named: bool, name: str = "target", width: float = 1.4,
) -> None:  # fmt: skip
    figure.add_trace(
        go.Scatter(x=x, y=y, mode="lines", line={**_TARGET, "width": width}, name=name,
                   legendgroup=name, showlegend=named),
        row=row, col=column,
    )  # fmt: skip


def _dots(
    figure: go.Figure, row: int, column: int, x: Sequence[float] | Array,
    y: Sequence[float] | Array, color: str,
) -> None:  # fmt: skip
    figure.add_trace(
        go.Scatter(x=x, y=y, mode="markers", marker={"color": color, "size": 7}, showlegend=False),
        row=row, col=column,
    )  # fmt: skip


def _marker(figure: go.Figure, row: int, column: int, x: float, y: float) -> None:
    figure.add_trace(
        go.Scatter(x=[x], y=[y], mode="markers", showlegend=False,
                   marker={"color": "#1f2933", "size": 10, "symbol": "x-thin",
                           "line": {"width": 2, "color": "#1f2933"}}),
        row=row, col=column,
    )  # fmt: skip
