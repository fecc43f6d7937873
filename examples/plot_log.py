"""Draw drives from their logs alone: candump lines, the shipped DBC, and matplotlib.

rt-controller --bus virtual --record drive.log && python examples/plot_log.py drive.svg drive.log
"""

import sys

import can
import cantools
import matplotlib.pyplot as plt
import numpy as np

from rt_controller.bus.dbc import DBC_PATH

catalogue = cantools.database.load_file(DBC_PATH)
figure, axes = plt.subplots(4, 1, figsize=(8, 8), sharex=True, layout="constrained")
for log in sys.argv[2:]:
    series = {}
    for frame in can.LogReader(log):
        message = catalogue.get_message_by_frame_id(frame.arbitration_id)
        for name, value in message.decode(frame.data, decode_choices=False).items():
            series.setdefault(f"{message.name}.{name}", []).append((frame.timestamp, value))
    start = next(time for time, mode in series["ACT_CMD.Mode"] if mode == 1)  # NOMINAL
    signals = {name: np.array(points).T - [[start], [0]] for name, points in series.items()}
    (t, lateral), (_, path) = signals["STATE_B.LateralError"], signals["REF_PATH.C0"]
    n = min(t.size, path.size)
    axes[0].plot(t[:n], path[:n], "k--", lw=1)
    axes[0].plot(t, lateral, label=log)
    axes[1].plot(t[:n], lateral[:n] - path[:n])
    axes[2].plot(*signals["ACT_CMD.SteeringWheelAngle"])
    axes[3].plot(*signals["STATE_A.VelocityX"] * [[1.0], [3.6]])
names = ("e_y, path dashed [m]", "lateral error [m]", "steering wheel [deg]", "v_x [km/h]")
for axis, name in zip(axes, names, strict=True):
    axis.set(ylabel=name, xlim=(0, None))
axes[0].legend()
axes[3].set_xlabel("time [s]")
figure.savefig(sys.argv[1])
print(f"{sys.argv[1]} written")
