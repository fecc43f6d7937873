"""Draw a drive from its log alone: candump lines, the shipped DBC, and matplotlib.

rt-controller --bus virtual --record network.log
rt-controller --bus virtual --record linear.log --model lti
python examples/plot_log.py drive.svg network.log linear.log
"""

from argparse import ArgumentParser
from collections import defaultdict
from pathlib import Path

import can
import cantools
import matplotlib.pyplot as plt
import numpy as np

from rt_controller.bus.dbc import DBC_PATH

CATALOGUE = cantools.database.load_file(DBC_PATH)


def read(log: str) -> dict[str, np.ndarray]:
    """Every signal of the log as (times, values), from the first NOMINAL command on."""
    series: dict[str, list[tuple[float, float]]] = defaultdict(list)
    start = None
    for frame in can.LogReader(log):
        message = CATALOGUE.get_message_by_frame_id(frame.arbitration_id)
        values = message.decode(frame.data, decode_choices=False)
        if start is None and message.name == "ACT_CMD" and values["Mode"] == 1:
            start = frame.timestamp
        for signal, value in values.items():
            if start is not None:
                series[f"{message.name}.{signal}"].append((frame.timestamp - start, value))
    return {name: np.array(points).T for name, points in series.items()}


def draw(picture: str, logs: list[str]) -> None:
    figure, axes = plt.subplots(4, 1, figsize=(8, 8), sharex=True, layout="constrained")
    for log in logs:
        signals, label = read(log), Path(log).stem
        (t, lateral), (_, path) = signals["STATE_B.LateralError"], signals["REF_PATH.C0"]
        n = min(lateral.size, path.size)
        if not axes[0].lines:
            axes[0].plot(t[:n], path[:n], "k--", lw=1, label="path")
        axes[0].plot(t, lateral, label=label)
        axes[1].plot(t[:n], lateral[:n] - path[:n])
        axes[2].plot(*signals["ACT_CMD.SteeringWheelAngle"])
        axes[3].plot(*signals["STATE_A.VelocityX"] * np.array([[1.0], [3.6]]))
    names = ("e_y [m]", "lateral error [m]", "steering wheel [deg]", "v_x [km/h]")
    for axis, name in zip(axes, names, strict=True):
        axis.set_ylabel(name)
        axis.grid(alpha=0.3)
    axes[0].legend(loc="upper right")
    axes[-1].set_xlabel("time [s]")
    figure.savefig(picture)


if __name__ == "__main__":
    parser = ArgumentParser(description="Draw drives from their CAN logs.")
    parser.add_argument("picture", help="file to write: .svg, .png or .pdf")
    parser.add_argument("logs", nargs="+", help="candump, .blf or .asc logs")
    arguments = parser.parse_args()
    draw(arguments.picture, arguments.logs)
