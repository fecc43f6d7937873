"""The plotly figures of frequency responses, part throttle, released body and locked stop."""

import plotly.graph_objects as go

from sim_bridge.validation.acceptance import LineResult, result_of, target_of
from sim_bridge.validation.frequency import PHASES_HZ, Responses
from sim_bridge.validation.measurements import Measurements
from sim_bridge.validation.plots.panels import BLUE, ORANGE, SERIES, TIME, Panels
from sim_bridge.validation.signal_metrics import FrequencyResponse

_BODE = (
    ("yaw rate / steering wheel, 1/s", "yaw"),
    ("lateral acceleration, g/100 deg", "lateral"),
    ("roll / lateral acceleration, deg/g", "roll"),
    ("sideslip / steering wheel, deg/deg", "sideslip"),
)


def frequency_responses(measured: Measurements) -> go.Figure:
    """Gain above phase of four signals at both speeds; crosses: the phases of a measured sedan."""
    panels = Panels(2, 4, 560)
    for speed, color in zip(measured.responses, SERIES, strict=False):
        for column, ((title, _), response) in enumerate(zip(_BODE, _all(speed), strict=True), 1):
            for row, y_title, y in (
                (1, title, response.gain),
                (2, "phase / deg", response.phase_deg),
            ):
                panels.select(row, column, "frequency / Hz", y_title)
                panels.line(response.frequency_hz, y, f"{3.6 * speed.speed_mps:.0f} km/h", color)
                panels.dots(response.frequency_hz, y, color)
                panels.set_log_x(row, column)
            panels.figure.update_yaxes(rangemode="tozero", row=1, col=column)
    for column, (_, name) in enumerate(_BODE, 1):
        if name in ("yaw", "roll"):
            panels.select(2, column, "frequency / Hz", "phase / deg")
            for hz in PHASES_HZ:
                panels.cross(hz, target_of(measured.results, f"{name} phase at {hz} Hz, 50 km/h"))
    return panels.figure


def _all(speed: Responses) -> tuple[FrequencyResponse, ...]:
    """In the order of `_BODE`."""
    return speed.yaw_rate, speed.lateral, speed.roll, speed.sideslip


def part_throttle(measured: Measurements) -> go.Figure:
    """Speed of launch and coast-down, and torque over engine speed during the launch."""
    run, coasting = measured.launch, measured.coasting
    panels = Panels(1, 3, 360)
    panels.select(1, 1, TIME, "launch: speed / (km/h)")
    panels.line(run.time_s, 3.6 * run.speed_mps)
    for kmh in (20, 60):
        goal = result_of(measured.results, f"0-{kmh} km/h with throttle 0.2")
        _range(panels, goal, kmh)
    panels.select(1, 2, "engine speed / rpm", "launch: torque / Nm")
    panels.line(run.column("engine_rpm"), run.column("engine_nm"))
    panels.cross(2390.0, target_of(measured.results, "torque at 2390 rpm, throttle 0.2"))
    panels.select(1, 3, TIME, "coast-down: speed / (km/h)")
    panels.line(coasting.time_s, 3.6 * coasting.speed_mps)
    return panels.figure


def _range(panels: Panels, goal: LineResult, height: float) -> None:
    """A thick dashed line over the times that pass."""
    if goal.low is not None and goal.high is not None:
        panels.target((goal.low, goal.high), (height, height), width=5.0)


def swings(measured: Measurements) -> go.Figure:
    """Heave and roll of the released body."""
    panels = Panels(1, 2, 360)
    for column, (swing, title) in enumerate(
        zip(measured.swings, ("heave / mm", "roll / mrad"), strict=True), 1
    ):
        panels.select(1, column, TIME, title)
        panels.line(swing.time_s, swing.position)
    return panels.figure


def locked_stop(measured: Measurements) -> go.Figure:
    """Speed of the stop, and its last part enlarged."""
    run = measured.stop
    panels = Panels(1, 2, 360)
    panels.select(1, 1, TIME, "speed / (km/h)")
    panels.line(run.time_s, 3.6 * run.speed_mps)
    late = run.speed_mps < 0.5
    panels.select(1, 2, TIME, "speed at the end / (mm/s)")
    late_s, late_mmps = run.time_s[late], 1e3 * run.speed_mps[late]
    panels.line(late_s, late_mmps, "car", BLUE)
    limit = target_of(measured.results, "speed backwards after a locked stop")
    panels.line(late_s, 0.0 * late_mmps - limit, "limit", ORANGE)
    return panels.figure
