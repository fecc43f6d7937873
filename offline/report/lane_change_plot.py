"""The paper's figure of the double lane change: six states of the car and of every model."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from offline.lane_change import LaneChange
from offline.report.canvas import FAINT, INK, Pen, add_legend, blank
from offline.table_units import table_columns
from rt_controller.contract.schema import VEHICLE

Array = NDArray[np.float64]


def lane_change_plot(
    driven: LaneChange,
    foreseen: Mapping[str, Array],
    drawn: Mapping[str, Pen],
    judged: Sequence[str],
) -> Figure:
    """Six states and the steering wheel over time; a line where the models start anew.

    `foreseen` holds by model what `offline.lane_change.predict_windows` returns.
    """
    columns, time_s = table_columns(VEHICLE), driven.time_s
    figure, panels = blank(4, 2, 9.6, sharex=True)
    for i, (axes, column) in enumerate(zip(panels, columns, strict=False)):
        truth = driven.windows.x[..., i].astype(np.float64) * column.per_si
        axes.plot(time_s.ravel(), truth.ravel(), color=INK, linewidth=1.1, label="car", zorder=2)
        for k, (name, states) in enumerate(foreseen.items()):
            pen = drawn[name]
            for window, series in enumerate(states[..., i] * column.per_si):
                axes.plot(time_s[window], series, color=pen.color, linestyle=pen.dashes,
                          linewidth=pen.width, label=name if window == 0 else None,
                          zorder=3 - 0.01 * k)  # fmt: skip
        _show_judged(axes, truth, [foreseen[n][..., i] * column.per_si for n in judged])
        axes.set_title(f"{column.name} / {column.unit}", loc="left")
    steering, wanted = panels[6], panels[7]
    steering.plot(time_s[:, :-1].ravel(), np.degrees(driven.windows.u[..., 2]).ravel(), color=INK,
                  linewidth=1.1)  # fmt: skip
    steering.set_title("input: steering wheel / deg", loc="left")
    wanted.plot(time_s.ravel(), driven.wanted_ey_m.ravel(), color=FAINT, linewidth=1.1,
                linestyle="--", label="scenario")  # fmt: skip
    wanted.plot(time_s.ravel(), driven.windows.x[..., 4].ravel(), color=INK, linewidth=1.1,
                label="car")  # fmt: skip
    wanted.set_title("way beside the road: scenario and car / m", loc="left")
    wanted.legend(fontsize=8, frameon=False)
    for axes in panels:
        for start_s in time_s[1:, 0]:
            axes.axvline(start_s, color=FAINT, linewidth=0.6, linestyle=":")
    for axes in panels[-2:]:
        axes.set_xlabel("time / s")
    add_legend(figure, panels[0])
    return figure


def _show_judged(axes: Axes, truth: Array, judged: list[Array]) -> None:
    """Room for the car and for the judged models; a rival that leaves it leaves the panel."""
    wrong = max((float(np.max(np.abs(_finite(one - truth)))) for one in judged), default=0.0)
    room = max(0.5 * float(np.ptp(truth)), 1.3 * wrong, 1e-9)
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, truth.min() - room), min(high, truth.max() + room))


def _finite(values: Array) -> Array:
    return values[np.isfinite(values)] if np.any(np.isfinite(values)) else np.zeros(1)
