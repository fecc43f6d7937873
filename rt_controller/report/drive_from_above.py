"""The moving picture of one drive: the whole way, and the road around the car."""

from io import BytesIO
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.plan_view import PlanView, corners, extent, plan_view, readings
from rt_controller.drive.table import Drive

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TICKS_PER_FRAME, MOST_FRAMES = 4, 200
"""a frame every 100 ms, of a longer drive a multiple of that: the file stays small"""
NEAR_M = (-12.0, -6.0), (68.0, 6.0)
"""corners of the part of the road that is seen, x along it; the origin is the car"""
NEAR_IN, NAMES_IN = 2.2, 0.2
"""height of this panel, and of names of axes"""
DOTS_PER_INCH, COLOURS = 72, 32


class _Panel:
    """A panel in which trail, prediction and car move, and the road if it `turns` with the car."""

    def __init__(self, axes: "Axes", drive: Drive, view: PlanView, turns: bool) -> None:
        from matplotlib.patches import Polygon
        from matplotlib.transforms import Affine2D

        from rt_controller.report.above import CAR, HORIZON, TRAIL, draw_road

        self._view, self._body, self._turns = view, drive.body, turns
        self._road_rad = np.interp(drive.poses[:, 0], view.road.s_m, view.road.heading_rad)
        draw_road(axes, view)
        # its end has a dot: on a long way the car is too small to see
        (self._trail,) = axes.plot(
            [], [], "o-", color=TRAIL, linewidth=2.5, markevery=[-1], markersize=4.0,
            markerfacecolor=CAR, markeredgecolor=CAR,
        )  # fmt: skip
        (self._ahead,) = axes.plot([], [], color=HORIZON, linewidth=1.5, zorder=2.5)
        self._outline = Polygon(np.zeros((5, 2)), closed=True, color=CAR, zorder=3)
        axes.add_patch(self._outline)
        self._place = Affine2D()
        for each in (*axes.lines, self._outline):
            each.set_transform(self._place + axes.transData)

    def move_to(self, tick: int) -> None:
        car = self._view.car
        self._trail.set_data(car.x_m[: tick + 1], car.y_m[: tick + 1])
        self._ahead.set_data(*self._view.horizons.get(tick, ([], [])))
        self._outline.set_xy(np.transpose(corners(car, tick, self._body)))
        if self._turns:
            self._place.clear().translate(-car.x_m[tick], -car.y_m[tick])
            self._place.rotate(-self._road_rad[tick])


def animate(drive: Drive) -> bytes:
    """A GIF: above the whole drive, below the road around the car, seen along it.

    Dashed is the path, light the way that the car has come, red what its controller predicts.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    from rt_controller.report.above import head_height_in, set_window
    from rt_controller.report.canvas import figure_under_head

    view, texts = plan_view(drive), readings(drive)
    whole_in = head_height_in([view]) + NAMES_IN
    figure, whole, (near,) = figure_under_head(1, whole_in, NEAR_IN)
    panels = _Panel(whole, drive, view, turns=False), _Panel(near, drive, view, turns=True)
    set_window(whole, *extent([view]))
    set_window(near, *np.array(NEAR_M))
    near.set_xlabel("along the road, from the car / m")
    near.set_ylabel("to the left / m")
    canvas, images = FigureCanvasAgg(figure), list[Image.Image]()
    figure.set_dpi(DOTS_PER_INCH)
    whole.set_title(texts[0], loc="left")
    canvas.draw()  # type: ignore[no-untyped-call]
    figure.set_layout_engine("none")  # the panels stay where they are
    ticks = TICKS_PER_FRAME * max(1, ceil(len(drive) / (TICKS_PER_FRAME * MOST_FRAMES)))
    for k in range(0, len(drive), ticks):
        for panel in panels:
            panel.move_to(k)
        whole.set_title(texts[k], loc="left", family="DejaVu Sans Mono")
        canvas.draw()  # type: ignore[no-untyped-call]
        pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        images.append(Image.fromarray(pixels).convert("RGB"))
    # One palette for all frames keeps the file small.
    palette = images[len(images) // 2].quantize(COLOURS)
    first, *others = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in images]
    out, duration_ms = BytesIO(), round(1e3 * ticks * PERIOD_S)
    first.save(out, "GIF", save_all=True, append_images=others, duration=duration_ms, loop=0)
    return out.getvalue()
