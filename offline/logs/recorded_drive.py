"""`RecordedDrive`: a drive of a real car for `offline-replay`, on an even time grid, checked.

A column whose name is a signal with its unit, such as `yaw_rate_degps`, is used as it is; others
are named by `--column NAME=COLUMN`. Axes: x forward, y left, z up; positive roll lowers the right
side. `NAME=-COLUMN` changes the sign, for logs with z down.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import NamedTuple

import numpy as np

from offline.logs.readers.formats import read_file
from offline.logs.readers.log import Request, Series
from offline.logs.series import runs
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.mapping.tables import Clock
from rt_controller.mapping.units import find_unit, require_unit, unit_of_name
from sim_bridge.plant.protocol import FASTEST_START_MPS

PERIOD_S = 0.01
_LEAST_SPEED_MPS, _LONGEST_GAP_S, _SHORTEST_S = 2.0, 0.5, 5.0
_TIMES = ("time_s", "time_ms", "time_us", "time_ns")
COMPARED = {
    "yaw_rate_radps": ("yaw_rate_radps", "yaw_rate_degps"),
    "vy_mps": ("vy_mps",),
    "ay_mps2": ("ay_mps2", "ay_g"),
    "accelerometer_left_mps2": ("accelerometer_left_mps2", "accelerometer_left_g"),
    "roll_rad": ("roll_rad", "roll_deg"),
}
"""signals of which a log contains at least one, by the names that their columns can have; with the
lateral velocity of the centre of gravity, its lateral acceleration, and the reading of an
accelerometer fixed to the body there"""
_NAMES = {
    "vx_mps": ("vx_mps", "vx_kmh"),
    "steer_rad": ("steer_rad", "steer_deg"),
    "road_wheel_rad": ("road_wheel_rad", "road_wheel_deg"),
} | COMPARED
_OPTIONAL = ("",)
"""the column may be missing"""
_SIGNAL_OF = {name: signal for signal, names in _NAMES.items() for name in names}


class Window(NamedTuple):
    """The part of a log that is used, counted from its beginning."""

    from_s: float = 0.0
    to_s: float = inf


WHOLE = Window()


@dataclass(frozen=True, slots=True)
class RecordedDrive:
    """A drive in SI units, every `PERIOD_S`."""

    name: str
    speed_mps: Array
    """(n,)"""
    steer_rad: Array
    """(n,) angle of the steering wheel, or of the road wheels without compliance"""
    is_road_wheel: bool
    signals: dict[str, Array]
    """(n,) each, those of `COMPARED` that the log contains"""


def load_drive(
    path: Path,
    assignments: Sequence[str] = (),
    period_s: float | None = None,
    window: Window = WHOLE,
) -> RecordedDrive:
    """The recorded drive of a log; signals are interpolated linearly.

    Args:
        assignments: `NAME=COLUMN`, or `NAME=-COLUMN` for the other sign.
        period_s: of a log without a column of times.

    Raises:
        ConfigError: an assignment is wrong; a signal is missing; there is a gap; a value is no
            number; the car stands, drives backwards or too fast; or the drive is too short.
        DatasetError: see `read_file`; also for times that do not increase.
    """
    names = {signal: (*own, *_OPTIONAL) for signal, own in _NAMES.items()}
    names["vx_mps"] = _NAMES["vx_mps"]
    clock = Clock(column=_TIMES[0], other_names=_TIMES[1:2])
    name_of = {}
    for text in assignments:
        name, _, column = text.partition("=")
        if not column or name not in (*_SIGNAL_OF, *_TIMES):
            raise ConfigError(
                f"--column {text}: expected NAME=COLUMN with a name out of "
                f"{', '.join((*_TIMES, *_SIGNAL_OF))}, found {name!r}."
            )
        if name in _TIMES:
            clock = Clock(column=column, unit=name.removeprefix("time_"))
        else:
            names[_SIGNAL_OF[name]] = (column.lstrip("-"),)
            name_of[column.lstrip("-")] = name, -1.0 if column.startswith("-") else 1.0
    if period_s is not None:
        clock = Clock(period_s=period_s)
    log, found = read_file(Request(path, list(names.values()), clock)), {}
    for series in log.channels:
        name, sign = name_of.get(series.column, (series.column, 1.0))
        unit, in_file = require_unit(unit_of_name(name) or "", name), find_unit(series.unit)
        if series.unit and in_file != unit:
            raise ConfigError(
                f"{series.place}: expected the unit of {name}, found {series.unit} in the file. "
                f"Name it by --column NAME=COLUMN with a name of that unit."
            )
        factor = sign * unit.factor
        found[_SIGNAL_OF[name]] = replace(series, values=factor * series.values)
    example = "Name columns by --column NAME=COLUMN, as in --column yaw_rate_degps=r."
    if len(found.keys() & {"steer_rad", "road_wheel_rad"}) != 1:
        raise ConfigError(
            f"{path}: expected either the angle of the steering wheel, steer_rad or steer_deg, or "
            f"that of the road wheels, road_wheel_rad or road_wheel_deg, found "
            f"{'both' if 'steer_rad' in found else 'neither'}. {example}"
        )
    if not found.keys() & COMPARED.keys():
        listed = ", ".join(name for own in COMPARED.values() for name in own)
        raise ConfigError(
            f"{path}: expected one of {listed} to compare with, found none. {example}"
        )
    return _on_grid(path, found, window)


def _on_grid(path: Path, found: dict[str, Series], window: Window) -> RecordedDrive:
    t_s = found["vx_mps"].t_s
    t_s = t_s[(t_s >= window.from_s) & (t_s <= window.to_s)]
    if len(t_s) < 2 or t_s[-1] - t_s[0] < _SHORTEST_S:
        raise ConfigError(
            f"{path}: expected at least {_SHORTEST_S:g} s, found "
            f"{np.ptp(t_s) if len(t_s) else 0.0:.3g} s between --from-s {window.from_s:g} and "
            f"--to-s {window.to_s:g}."
        )
    grid_s = np.arange(t_s[0], t_s[-1] + 1e-9, PERIOD_S)
    even: dict[str, Array] = {}
    for signal, series in found.items():
        own = (series.t_s >= window.from_s) & (series.t_s <= window.to_s)
        own_t_s, values = series.t_s[own], series.values[own]
        known_s = np.concatenate([[t_s[0]], own_t_s, [t_s[-1]]])
        gap = int(np.argmax(np.diff(known_s)))
        if known_s[gap + 1] - known_s[gap] > _LONGEST_GAP_S:
            raise ConfigError(
                f"{series.place}: expected no gap above {_LONGEST_GAP_S} s, found "
                f"{known_s[gap + 1] - known_s[gap]:.3g} s at {known_s[gap]:.6g} s. Is the unit of "
                f"time right? Use the part before or after by --from-s and --to-s."
            )
        wrong = np.flatnonzero(~np.isfinite(values))
        if len(wrong):
            raise ConfigError(
                f"{series.place}: expected numbers, found {values[wrong[0]]} at "
                f"{own_t_s[wrong[0]]:.6g} s, and {len(wrong)} such samples. Fill them, or use "
                f"the part before or after by --from-s and --to-s."
            )
        even[signal] = np.interp(grid_s, own_t_s, values)
    speed_mps = even.pop("vx_mps")
    is_usable = (speed_mps >= _LEAST_SPEED_MPS) & (speed_mps <= FASTEST_START_MPS)
    if not is_usable.all():
        k = int(np.argmin(is_usable))
        begin, end = max(runs(is_usable), key=lambda run: run[1] - run[0], default=(0, 0))
        part = f"--from-s {grid_s[begin]:.2f} --to-s {grid_s[end - 1]:.2f}" if end else "none"
        raise ConfigError(
            f"{path}: expected a car that drives forward with {_LEAST_SPEED_MPS:g} to "
            f"{FASTEST_START_MPS:g} m/s, found {speed_mps[k]:.4g} m/s at {grid_s[k]:.6g} s. Are "
            f"unit and sign of the speed right (--column vx_kmh=COLUMN)? The longest usable part: "
            f"{part}."
        )
    is_road_wheel = "road_wheel_rad" in even
    steer_rad = even.pop("road_wheel_rad" if is_road_wheel else "steer_rad")
    return RecordedDrive(path.name, speed_mps, steer_rad, is_road_wheel, even)
