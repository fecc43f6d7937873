"""The moving picture of one drive: the car on its road, seen from above, in real time."""

from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.table import Drive, filled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TICKS_PER_FRAME = 4
"""a frame every 100 ms"""
BEHIND_M, AHEAD_M, BESIDE_M = 12.0, 68.0, 5.5
"""what is seen around the car"""
LENGTH_M, WIDTH_M = 4.6, 1.8
"""of the car that is drawn"""
DOTS_PER_INCH, COLOURS = 72, 16
KMH_PER_MPS = 3.6
CAR, TRAIL, CONE = "#2f6fb3", "#9dc1e6", "#d9822b"


def animate(drive: Drive) -> bytes:
    """A GIF: the road is stretched straight, so its place and offset are the axes.

    Dashed is the path, light the way that the car has come.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.patches import Polygon
    from PIL import Image

    from rt_controller.report.canvas import FAINT, empty_figure

    figure, (axes,) = empty_figure(1, 1, 2.1)
    figure.set_layout_engine("none")
    axes.set_position((0.06, 0.22, 0.92, 0.64))
    s, ey, epsi = (filled(drive[name]) for name in ("s_m", "ey_m", "epsi_rad"))
    path, vx, wheel = (filled(drive[name]) for name in ("path_ey_m", "vx_mps", "steer_rad"))
    middle_m = 0.5 * (np.min(path) + np.max(path))
    axes.set_aspect("equal")
    axes.set_xlabel("place on the road / m")
    axes.set_ylabel("e_y / m")
    _draw_cones(axes, drive)
    axes.plot(s, path, "--", color=FAINT, linewidth=1.2)
    (trail,) = axes.plot([], [], color=TRAIL, linewidth=2.5)
    car = Polygon(np.zeros((4, 2)), closed=True, color=CAR, zorder=3)
    axes.add_patch(car)
    canvas, images = FigureCanvasAgg(figure), list[Image.Image]()
    figure.set_dpi(DOTS_PER_INCH)
    for k in range(0, len(drive), TICKS_PER_FRAME):
        trail.set_data(s[: k + 1], ey[: k + 1])
        car.set_xy(_corners(s[k], ey[k], epsi[k]))
        axes.set_xlim(s[k] - BEHIND_M, s[k] + AHEAD_M)
        seen_m = BESIDE_M - 0.5 * LENGTH_M  # a car that leaves its path stays in the picture
        centre_m = min(max(middle_m, ey[k] - seen_m), ey[k] + seen_m)
        axes.set_ylim(centre_m - BESIDE_M, centre_m + BESIDE_M)
        axes.set_title(
            f"{k * PERIOD_S:4.1f} s   {KMH_PER_MPS * vx[k]:3.0f} km/h   lateral error "
            f"{1e3 * (ey[k] - path[k]):+4.0f} mm   steering wheel {np.degrees(wheel[k]):+4.0f} deg",
            family="DejaVu Sans Mono",
        )
        canvas.draw()  # type: ignore[no-untyped-call]
        pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        images.append(Image.fromarray(pixels).convert("RGB"))
    palette = images[len(images) // 2].quantize(COLOURS)
    frames = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in images]
    out, duration_ms = BytesIO(), round(1e3 * TICKS_PER_FRAME * PERIOD_S)
    frames[0].save(
        out, "GIF", save_all=True, append_images=frames[1:], duration=duration_ms, loop=0
    )
    return out.getvalue()


def _corners(s_m: float, ey_m: float, epsi_rad: float) -> Array:
    half = 0.5 * np.array([LENGTH_M, WIDTH_M])
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * half
    cos, sin = np.cos(epsi_rad), np.sin(epsi_rad)
    return np.asarray(corners @ np.array([[cos, sin], [-sin, cos]]) + (s_m, ey_m))


def _draw_cones(axes: "Axes", drive: Drive) -> None:
    if drive.scenario is not None and drive.scenario.cones:
        s_m, ey_m = zip(*drive.scenario.cones, strict=True)
        axes.plot(s_m, ey_m, "^", color=CONE, markersize=4.0)
