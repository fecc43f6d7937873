"""A drive as long as is wanted: a lane change now and then, on a constant curve."""

from pathlib import Path

from rt_controller.contract.timing import PERIOD_S

SPEED_KMH = 80.0
EVERY_M = 400.0
LANE_M, LENGTH_M = 3.5, 60.0
_HEAD = """\
name = "weave"
speed_kmh = {speed}
curvature_per_m = 0.001
duration_s = {duration}
road_friction = 0.85
"""
_MOVE = """
[[moves]]
start_m = {start}
length_m = {length}
to_m = {to}
"""


def write_weave(file: Path, ticks: int) -> None:
    """A scenario file of so many ticks."""
    duration_s = ticks * PERIOD_S
    moves = int(duration_s * SPEED_KMH / 3.6 / EVERY_M) + 1
    file.write_text(
        _HEAD.format(speed=SPEED_KMH, duration=duration_s)
        + "".join(
            _MOVE.format(
                start=25.0 + k * EVERY_M, length=LENGTH_M, to=LANE_M if k % 2 == 0 else 0.0
            )
            for k in range(moves)
        )
    )
