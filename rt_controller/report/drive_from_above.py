"""The moving picture of one drive: the car from above, in the plane and along its road."""

from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.plan_view import Line, PlanView, Poses, corners, plan_view
from rt_controller.drive.table import Drive, filled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from PIL.Image import Image

TICKS_PER_FRAME = 4
"""a frame every 100 ms"""
BEHIND_M, AHEAD_M, BESIDE_M = 12.0, 68.0, 5.5
"""of the road that is seen around the car"""
LONGEST_WHOLE_M = 260.0
"""a longer drive is seen in a window of this width, which follows the car"""
STRIP_IN = 2.1
DOTS_PER_INCH, COLOURS = 72, 16
KMH_PER_MPS = 3.6


class _Panel:
    """A panel in which trail, prediction and car move."""

    def __init__(self, axes: "Axes", car: Poses, horizons: dict[int, Line], drive: Drive) -> None:
        from matplotlib.patches import Polygon

        from rt_controller.report.above import CAR, HORIZON, TRAIL

        self._car, self._horizons, self._body = car, horizons, drive.body
        (self._trail,) = axes.plot([], [], color=TRAIL, linewidth=2.5)
        (self._ahead,) = axes.plot([], [], color=HORIZON, linewidth=1.5, zorder=2.5)
        self._outline = Polygon(np.zeros((4, 2)), closed=True, color=CAR, zorder=3)
        axes.add_patch(self._outline)

    def move_to(self, tick: int) -> None:
        self._trail.set_data(self._car.x_m[: tick + 1], self._car.y_m[: tick + 1])
        self._ahead.set_data(*self._horizons.get(tick, ([], [])))
        self._outline.set_xy(np.transpose(corners(self._car, tick, self._body)))


def animate(drive: Drive) -> bytes:
    """A GIF: above the drive in the plane, below its road stretched straight around the car.

    Dashed is the path, light the way that the car has come, red what its controller predicts.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    from rt_controller.report.above import draw_road, head_height_in
    from rt_controller.report.canvas import figure_under_head

    view = plan_view(drive)
    head_in = head_height_in([view])
    figure, plane, (road,) = figure_under_head(1, head_in, STRIP_IN)
    figure.set_layout_engine("none")
    height_in = head_in + STRIP_IN
    plane.set_position((0.06, (STRIP_IN + 0.45) / height_in, 0.92, (head_in - 0.8) / height_in))
    road.set_position((0.06, 0.45 / height_in, 0.92, (STRIP_IN - 0.7) / height_in))
    draw_road(plane, view)
    _draw_strip(road, drive)
    s, ey, epsi = drive.poses.T
    path, vx, wheel = (filled(drive[name]) for name in ("path_ey_m", "vx_mps", "steer_rad"))
    middle_m = 0.5 * (np.min(path) + np.max(path))
    along = {each.tick: Line(each.s_m, each.ey_m) for each in drive.horizons}
    panels = (
        _Panel(plane, view.car, view.horizons, drive),
        _Panel(road, Poses(s, ey, epsi), along, drive),
    )
    canvas, images = FigureCanvasAgg(figure), list[Image.Image]()
    figure.set_dpi(DOTS_PER_INCH)
    for k in range(0, len(drive), TICKS_PER_FRAME):
        for panel in panels:
            panel.move_to(k)
        _follow(plane, view, k)
        road.set_xlim(s[k] - BEHIND_M, s[k] + AHEAD_M)
        seen_m = BESIDE_M - 0.5 * (drive.body.front_m + drive.body.rear_m)
        # a car that leaves its path stays in the picture
        centre_m = min(max(middle_m, ey[k] - seen_m), ey[k] + seen_m)
        road.set_ylim(centre_m - BESIDE_M, centre_m + BESIDE_M)
        plane.set_title(
            f"{k * PERIOD_S:4.1f} s   {KMH_PER_MPS * vx[k]:3.0f} km/h   lateral error "
            f"{1e3 * (ey[k] - path[k]):+4.0f} mm   steering wheel {np.degrees(wheel[k]):+4.0f} deg",
            family="DejaVu Sans Mono",
        )
        canvas.draw()  # type: ignore[no-untyped-call]
        pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        images.append(Image.fromarray(pixels).convert("RGB"))
    return _to_gif(images)


def _draw_strip(axes: "Axes", drive: Drive) -> None:
    """Draw path and cones along the road."""
    from rt_controller.report.above import CONE
    from rt_controller.report.canvas import FAINT

    axes.set_aspect("equal")
    axes.set_xlabel("place on the road / m")
    axes.set_ylabel("e_y / m")
    axes.plot(drive.poses[:, 0], drive["path_ey_m"], "--", color=FAINT, linewidth=1.2)
    if drive.scenario is not None and drive.scenario.cones:
        axes.plot(*np.transpose(drive.scenario.cones), "^", color=CONE, markersize=4.0)


def _follow(axes: "Axes", view: PlanView, tick: int) -> None:
    """Show the whole drive, or of a long one the part around the car."""
    from rt_controller.report.above import set_window

    low, high = set_window(axes, [view])
    box = axes.get_position().size * axes.figure.get_size_inches()
    if max((high - low) / box) * box[0] <= LONGEST_WHOLE_M:
        return
    half_m = 0.5 * LONGEST_WHOLE_M * np.array([1.0, box[1] / box[0]])
    x_m, y_m = view.car.x_m[tick], view.car.y_m[tick]
    axes.set_xlim(x_m - half_m[0], x_m + half_m[0], auto=True)
    axes.set_ylim(y_m - half_m[1], y_m + half_m[1], auto=True)


def _to_gif(images: "list[Image]") -> bytes:
    from PIL.Image import Dither

    palette = images[len(images) // 2].quantize(COLOURS)
    frames = [each.quantize(palette=palette, dither=Dither.NONE) for each in images]
    out, duration_ms = BytesIO(), round(1e3 * TICKS_PER_FRAME * PERIOD_S)
    frames[0].save(
        out, "GIF", save_all=True, append_images=frames[1:], duration=duration_ms, loop=0
    )
    return out.getvalue()
