"""The plotly figures of the acceptance page, with the targets of the lines in them."""

import numpy as np
import plotly.graph_objects as go

from rt_controller.contract.physics import GRAVITY_MPS2
from sim_bridge.validation import dwell as dwell_test
from sim_bridge.validation.acceptance import result_of, target_of
from sim_bridge.validation.lane_change import CORNERS_M
from sim_bridge.validation.longitudinal import HUNDRED_MPS, rim_mps
from sim_bridge.validation.measurements import Measurements
from sim_bridge.validation.plots import responses
from sim_bridge.validation.plots.panels import GREEN, GREY, ORANGE, SERIES, TIME, Panels


def _cornering(measured: Measurements) -> go.Figure:
    """Angles over lateral acceleration.

    A target line passes through the measured point at 0.05 g, because the target is a slope.
    """
    run = measured.cornering
    panels = Panels(1, 3, 340)
    curves = (
        ("steering wheel angle / deg", run.steer_deg, "steering effort"),
        ("roll / deg", run.roll_deg, "roll"),
        ("sideslip / deg", run.sideslip_deg, "sideslip"),
    )
    for column, (title, angle_deg, line) in enumerate(curves, 1):
        panels.select(1, column, "lateral acceleration / g", title)
        target_degpg = target_of(measured.results, line)
        start_deg = float(np.interp(0.05, run.lateral_g, angle_deg)) - 0.05 * target_degpg
        panels.line(run.lateral_g, angle_deg)
        panels.target((0.0, 0.4), (start_deg, start_deg + 0.4 * target_degpg))
        if column == 1:
            panels.cross(0.3, target_of(measured.results, "steering wheel angle at 0.3 g"))
    return panels.figure


def _lane_change(measured: Measurements) -> go.Figure:
    """Path, steering wheel angle and the four judged signals."""
    run = measured.lane_change
    panels = Panels(3, 2, 780)
    corners_m = np.vstack(((0.0, 0.0), CORNERS_M, (run.x_m[-1], 0.0)))
    panels.select(1, 1, "distance ahead / m", "lateral position / m")
    panels.line(run.x_m, run.y_m)
    panels.line(corners_m[:, 0], corners_m[:, 1], "path", GREY)
    wheel = "largest steering wheel angle to the"
    for row, column, title, signal, lines in (
        (1, 2, "steering wheel / deg", run.steer_deg, (f"{wheel} right", f"{wheel} left")),
        (2, 1, "lateral acceleration / g", run.lateral_g, ("peak lateral acceleration",)),
        (2, 2, "yaw rate / (deg/s)", run.yaw_rate_degps, ("peak yaw rate",)),
        (3, 1, "sideslip / deg", run.sideslip_deg, ("peak sideslip",)),
        (3, 2, "roll / deg", run.roll_deg, ("peak roll",)),
    ):
        panels.select(row, column, TIME, title)
        panels.line(run.time_s, signal)
        targets = [target_of(measured.results, line) for line in lines]
        # A peak is a target for both sides.
        for value in targets if len(targets) == 2 else (targets[0], -targets[0]):
            panels.level(run.time_s[-1], value)
    return panels.figure


def _cross_check(measured: Measurements) -> go.Figure:
    """Yaw rate and roll of both models."""
    panels = Panels(1, 2, 400)
    for ours, reference in measured.turns:
        for column, title, y, reference_y in (
            (1, "yaw rate / (deg/s)", ours.yaw_rate_degps, reference.yaw_rate_degps),
            (2, "roll / deg", ours.roll_deg, reference.roll_deg),
        ):
            panels.select(1, column, TIME, title)
            panels.line(ours.time_s, y, "this plant")
            panels.target(reference.time_s[::10], reference_y[::10], "commonroad-vehicle-models")
    return panels.figure


def _steps(measured: Measurements) -> go.Figure:
    """Step steer at both speeds; a dot at 90 % of the steady value."""
    panels = Panels(1, 3, 360)
    steps = measured.steps
    titles = ("steering wheel / deg", "yaw rate / (deg/s)", "lateral acceleration / (m/s²)")
    for column, title in enumerate(titles, 1):
        panels.select(1, column, TIME, title)
        for step, color in zip(steps, SERIES, strict=False):
            run = step.run
            signal = (run.steer_deg, run.yaw_rate_degps, run.column("ay_mps2"))[column - 1]
            panels.line(run.time_s, signal, f"{3.6 * run.speed_mps[0]:.0f} km/h", color)
            if column > 1:
                response = step.yaw_rate if column == 2 else step.lateral
                panels.dots([step.step_s + response.t90_s], [0.9 * response.steady], color)
    return panels.figure


def _dwell(measured: Measurements) -> go.Figure:
    """Steering wheel, yaw rate over its peak, and lateral position, for every amplitude."""
    panels = Panels(1, 3, 400)
    for one, color in zip(measured.dwell, SERIES, strict=False):
        run = one.run
        share = -100.0 * run.yaw_rate_degps / one.second_peak_degps
        for column, title, y in (
            (1, "steering wheel / deg", run.steer_deg),
            (2, "yaw rate / % of its second peak", share),
            (3, "lateral position / m", run.y_m),
        ):
            panels.select(1, column, TIME, title)
            panels.line(run.time_s, y, f"{one.amplitude_deg:.0f} deg", color)
    panels.select(1, 2, TIME, "yaw rate / % of its second peak")
    for after_s in (1.0, 1.75):
        limit = target_of(measured.results, f"yaw rate {after_s:.2f} s after the steering")
        panels.cross(dwell_test.END_S + after_s, limit)
    panels.select(1, 3, TIME, "lateral position / m")
    displaced_s = dwell_test.START_S + dwell_test.DISPLACED_AFTER_S
    panels.cross(displaced_s, target_of(measured.results, "lateral displacement after 1.07 s"))
    return panels.figure


def _braking(measured: Measurements) -> go.Figure:
    """Speed, wheel speeds and deceleration."""
    run = measured.braking
    panels = Panels(1, 2, 360)
    rims_kmh = 3.6 * rim_mps(run)
    panels.select(1, 1, TIME, "speed / (km/h)")
    panels.line(run.time_s, 3.6 * run.speed_mps)
    panels.line(run.time_s, rims_kmh[:, 0], "front wheel", ORANGE)
    panels.line(run.time_s, rims_kmh[:, 2], "rear wheel", GREEN)
    panels.select(1, 2, TIME, "deceleration / g")
    panels.line(run.time_s, -run.column("ax_mps2") / GRAVITY_MPS2)
    panels.level(run.time_s[-1], target_of(measured.results, "deceleration with 150 N"))
    return panels.figure


def _acceleration(measured: Measurements) -> go.Figure:
    """Speed with the range of the target, gear, and engine speed."""
    run = measured.full_throttle
    panels = Panels(1, 3, 360)
    panels.select(1, 1, TIME, "speed / (km/h)")
    panels.line(run.time_s, 3.6 * run.speed_mps)
    goal = result_of(measured.results, "0-100 km/h")
    if goal.low is not None and goal.high is not None:
        hundred_kmh = 3.6 * HUNDRED_MPS
        panels.target((goal.low, goal.high), (hundred_kmh, hundred_kmh), width=5.0)
    panels.select(1, 2, TIME, "gear")
    panels.line(run.time_s, run.column("gear"))
    panels.select(1, 3, TIME, "engine speed / rpm")
    panels.line(run.time_s, run.column("engine_rpm"))
    return panels.figure


FIGURES = {
    2: (_cornering,),
    3: (_lane_change,),
    4: (_cross_check,),
    5: (_steps,),
    6: (_dwell,),
    7: (_braking, _acceleration),
    8: (responses.frequency_responses,),
    9: (responses.part_throttle,),
    10: (responses.swings,),
    11: (responses.locked_stop,),
}
"""the functions that draw the figures of a test, by its number"""
