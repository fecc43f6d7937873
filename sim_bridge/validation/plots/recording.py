"""The plotly figure of a replay: recorded signals and those of the car over time."""

import numpy as np
import plotly.graph_objects as go

from sim_bridge.validation.plots.panels import BLUE, ORANGE, TIME, Panels
from sim_bridge.validation.recording.replay import SPEED_RATE, Replay

_MOST_POINTS = 3000
TITLES = {
    SPEED_RATE: "rate of the speed / (m/s²)",
    "yaw_rate_radps": "yaw rate / (rad/s)",
    "vy_mps": "lateral velocity / (m/s)",
    "ay_mps2": "lateral acceleration / (m/s²)",
    "accelerometer_left_mps2": "accelerometer, left / (m/s²)",
    "roll_rad": "roll / rad",
}
"""of the axes, by the names of the signals"""


def traces(replay: Replay) -> go.Figure:
    """Steering, speed and each compared signal, one above the other."""
    recording = replay.recording
    thin = slice(None, None, max(1, len(recording.time_s) // _MOST_POINTS))
    time_s = recording.time_s[thin]
    wheel = "road wheel" if recording.is_road_wheel else "steering wheel"
    rows = 2 + len(replay.signals)
    panels = Panels(rows, 1, 220 * rows)
    panels.select(1, 1, TIME, f"{wheel} / deg")
    panels.line(time_s, np.degrees(recording.steer_rad)[thin], "recorded", ORANGE)
    panels.select(2, 1, TIME, "speed / (km/h)")
    panels.line(time_s, 3.6 * recording.speed_mps[thin], "recorded", ORANGE)
    for row, (recorded, car) in enumerate(replay.signals, 3):
        panels.select(row, 1, TIME, TITLES[recorded.name])
        panels.line(time_s, recorded.values[thin], "recorded", ORANGE)
        panels.line(time_s, car.values[thin], "car", BLUE)
    return panels.figure
