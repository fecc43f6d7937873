"""Which column of a log is which signal: names with units, and `--column NAME=COLUMN`.

A name states the signal and its unit, such as `yaw_rate_degps`. Axes: x forward, y left, z up;
positive roll lowers the right side. `-COLUMN` changes the sign, for logs with z down.
"""

from collections.abc import Iterable
from math import pi
from typing import NamedTuple

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.physics import GRAVITY_MPS2

_RAD_PER_DEG = pi / 180.0


class Unit(NamedTuple):
    """A signal in one of its units."""

    signal: str
    """name of the signal with its SI unit"""
    factor: float
    """to SI"""


UNITS = {
    "time_s": Unit("time_s", 1.0),
    "time_ms": Unit("time_s", 1e-3),
    "time_us": Unit("time_s", 1e-6),
    "time_ns": Unit("time_s", 1e-9),
    "steer_rad": Unit("steer_rad", 1.0),
    "steer_deg": Unit("steer_rad", _RAD_PER_DEG),
    "road_wheel_rad": Unit("road_wheel_rad", 1.0),
    "road_wheel_deg": Unit("road_wheel_rad", _RAD_PER_DEG),
    "vx_mps": Unit("vx_mps", 1.0),
    "vx_kmh": Unit("vx_mps", 1.0 / 3.6),
    "vy_mps": Unit("vy_mps", 1.0),
    "yaw_rate_radps": Unit("yaw_rate_radps", 1.0),
    "yaw_rate_degps": Unit("yaw_rate_radps", _RAD_PER_DEG),
    "ay_mps2": Unit("ay_mps2", 1.0),
    "ay_g": Unit("ay_mps2", GRAVITY_MPS2),
    "accelerometer_left_mps2": Unit("accelerometer_left_mps2", 1.0),
    "accelerometer_left_g": Unit("accelerometer_left_mps2", GRAVITY_MPS2),
    "roll_rad": Unit("roll_rad", 1.0),
    "roll_deg": Unit("roll_rad", _RAD_PER_DEG),
}
"""by the names that a column can have"""
COMPARED = ("yaw_rate_radps", "vy_mps", "ay_mps2", "accelerometer_left_mps2", "roll_rad")
"""signals of which a log contains at least one; with the lateral velocity of the centre of gravity,
its lateral acceleration, and the reading of an accelerometer fixed to the body there"""
STEERING = ("steer_rad", "road_wheel_rad")
"""angle of the steering wheel, or of the road wheels; a log contains one"""


class Column(NamedTuple):
    """A column of a log and what it contains."""

    title: str
    """in the log"""
    signal: str
    """with its SI unit"""
    factor: float
    """from the log to SI, negative if the log has the other sign"""


def assign(titles: Iterable[str], assignments: Iterable[str], log: str) -> tuple[Column, ...]:
    """The columns of a log that are used.

    Args:
        titles: all columns of the log; one with a name of `UNITS` needs no assignment.
        assignments: `NAME=COLUMN`, or `NAME=-COLUMN` for the other sign.

    Raises:
        ConfigError: a name or a column does not exist, a signal is there twice, or one is missing.
    """
    titles = list(titles)
    problems: list[str] = []
    columns = [_assigned(text, titles, problems) for text in assignments]
    used = {column.title for column in columns if column is not None}
    given = {column.signal for column in columns if column is not None}
    for title in titles:
        unit = UNITS.get(title)
        if unit is not None and title not in used and unit.signal not in given:
            columns.append(Column(title, *unit))
    known = tuple(column for column in columns if column is not None)
    signals = [column.signal for column in known]
    problems += [
        f"{signal}: expected one column, found "
        f"{', '.join(column.title for column in known if column.signal == signal)}. Assign one with"
        f" --column."
        for signal in dict.fromkeys(signals)
        if signals.count(signal) > 1
    ]
    problems += _missing(set(signals), titles)
    if problems:
        raise ConfigError(f"{log}:\n  " + "\n  ".join(problems))
    return known


def _assigned(text: str, titles: list[str], problems: list[str]) -> Column | None:
    name, separator, title = text.partition("=")
    sign = 1.0
    if title not in titles and title.startswith("-"):
        title, sign = title[1:], -1.0
    if not separator or name not in UNITS:
        problems.append(
            f"--column {text}: expected NAME=COLUMN with a name out of {', '.join(UNITS)}, found "
            f"{name!r}."
        )
    elif title not in titles:
        problems.append(
            f"--column {text}: expected a column of the log, which has {', '.join(titles)}, found "
            f"{title!r}."
        )
    else:
        return Column(title, UNITS[name].signal, sign * UNITS[name].factor)
    return None


def _missing(signals: set[str], titles: list[str]) -> list[str]:
    """One sentence for each signal that a replay needs and the log does not have."""
    listed = ", ".join(titles) or "no column"
    problems = []
    if "vx_mps" not in signals:
        problems.append(f"speed: expected a column vx_mps or vx_kmh, found {listed}.")
    if len(signals.intersection(STEERING)) != 1:
        found = "both" if signals.issuperset(STEERING) else listed
        problems.append(
            f"steering: expected either the angle of the steering wheel, steer_rad or steer_deg, "
            f"or that of the road wheels, road_wheel_rad or road_wheel_deg, found {found}."
        )
    if not signals.intersection(COMPARED):
        problems.append(
            f"nothing to compare with: expected one of {', '.join(COMPARED)}, found {listed}."
        )
    if problems:
        problems[-1] += " Name columns by --column NAME=COLUMN, as in --column yaw_rate_degps=r."
    return problems
