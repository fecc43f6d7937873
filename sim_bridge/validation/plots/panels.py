"""`Panels`: a plotly figure of several panels in the style of the reports."""

from collections.abc import Sequence
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from rt_controller.contract.arrays import Array

INK, BLUE, ORANGE, GREEN, GREY = "#1f2933", "#2f6fb3", "#d9822b", "#3c9d6b", "#8a97a5"
SERIES = (BLUE, ORANGE, GREEN, "#7b5ea7", "#c0392b", "#4b9fb5", "#a0713b")
TIME = "time / s"
Points = Sequence[float] | Array


class Panels:
    """A figure of several panels; a legend entry appears once for each name."""

    def __init__(self, rows: int, columns: int, height: int) -> None:
        self.figure = make_subplots(
            rows, columns, horizontal_spacing=0.24 / columns, vertical_spacing=0.28 / rows
        )
        self.figure.update_layout(
            template="plotly_white",
            height=height,
            margin={"l": 60, "r": 20, "t": 40, "b": 50},
            legend={"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0.0},
            font={"family": "system-ui, sans-serif", "size": 13, "color": INK},
        )
        self._named: set[str] = set()
        self._row, self._column = 1, 1

    def select(self, row: int, column: int, x_title: str, y_title: str) -> None:
        """Make this panel the one that is drawn in."""
        self._row, self._column = row, column
        for update, title in (
            (self.figure.update_xaxes, x_title),
            (self.figure.update_yaxes, y_title),
        ):
            update(title={"text": title, "standoff": 6}, row=row, col=column)

    def set_log_x(self, row: int, column: int) -> None:
        """Logarithmic horizontal axis of one panel."""
        self.figure.update_xaxes(type="log", row=row, col=column)

    def line(self, x: Points, y: Points, name: str = "car", color: str = BLUE) -> None:
        self._add(x, y, name, mode="lines", line={"color": color, "width": 1.8})

    def target(self, x: Points, y: Points, name: str = "target", width: float = 1.4) -> None:
        line = {"color": "#52606d", "dash": "dash", "width": width}
        self._add(x, y, name, mode="lines", line=line)

    def level(self, end: float, value: float) -> None:
        """A target that is constant from 0 to `end`."""
        self.target((0.0, end), (value, value))

    def dots(self, x: Points, y: Points, color: str) -> None:
        self._add(x, y, mode="markers", marker={"color": color, "size": 7})

    def cross(self, x: float, y: float) -> None:
        line = {"width": 2, "color": INK}
        marker = {"color": INK, "size": 10, "symbol": "x-thin", "line": line}
        self._add([x], [y], mode="markers", marker=marker)

    def _add(self, x: Points, y: Points, name: str = "", **style: Any) -> None:
        is_new = bool(name) and name not in self._named
        self._named.add(name)
        trace = go.Scatter(x=x, y=y, name=name, legendgroup=name, showlegend=is_new, **style)
        self.figure.add_trace(trace, row=self._row, col=self._column)
