"""`Recording`: a drive of a real car on an even time grid, checked."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from sim_bridge.plant.protocol import FASTEST_START_MPS
from sim_bridge.validation.recording.columns import COMPARED, Column, assign
from sim_bridge.validation.recording.log_file import LogFile, read_log

PERIOD_S = 0.01
LEAST_SPEED_MPS = 2.0
_LONGEST_GAP_S = 0.5
_SHORTEST_S = 5.0


@dataclass(frozen=True, slots=True)
class Signal:
    """One recorded signal that is compared."""

    name: str
    """with its SI unit"""
    values: Array
    """(n,)"""


@dataclass(frozen=True, slots=True)
class Recording:
    """A drive in SI units, every `PERIOD_S`."""

    name: str
    time_s: Array
    """(n,) from the beginning of the log"""
    speed_mps: Array
    steer_rad: Array
    """angle of the steering wheel, or of the road wheels"""
    is_road_wheel: bool
    signals: tuple[Signal, ...]


@dataclass(frozen=True, slots=True)
class Window:
    """The part of a log that is used."""

    from_s: float = 0.0
    to_s: float = inf


def load_recording(
    path: Path,
    assignments: Sequence[str] = (),
    log_period_s: float | None = None,
    window: Window = Window(),
) -> Recording:
    """The recording of a log; signals are interpolated linearly.

    Args:
        assignments: see `columns.assign`.
        log_period_s: of a log without a column of times.

    Raises:
        ConfigError: a column is missing; the time does not increase; there is a gap; a value is no
            number; the car stands, drives backwards or too fast; or the drive is too short.
        MissingExtraError: see `read_log`.
    """
    log = read_log(path)
    columns = assign(log.titles, assignments, str(path))
    signals = {column.signal: column for column in columns}
    time_s = _times_s(log, signals.get("time_s"), log_period_s)
    inside = (time_s >= window.from_s) & (time_s <= window.to_s)
    time_s = time_s[inside]
    if len(time_s) < 2 or time_s[-1] - time_s[0] < _SHORTEST_S:
        length_s = float(time_s[-1] - time_s[0]) if len(time_s) else 0.0
        raise ConfigError(
            f"{path}: expected at least {_SHORTEST_S:g} s, found {length_s:.3g} s between --from-s "
            f"{window.from_s:g} and --to-s {window.to_s:g}."
        )
    values = {
        signal: column.factor * log.column(column.title)[inside]
        for signal, column in signals.items()
        if signal != "time_s"
    }
    _require_numbers(path, time_s, [(signals[s].title, v) for s, v in values.items()])
    _require_driving(path, time_s, values["vx_mps"])
    grid_s = time_s[0] + PERIOD_S * np.arange(int((time_s[-1] - time_s[0]) / PERIOD_S) + 1)
    even = {signal: np.interp(grid_s, time_s, v) for signal, v in values.items()}
    is_road_wheel = "road_wheel_rad" in even
    return Recording(
        path.name,
        grid_s,
        even["vx_mps"],
        even["road_wheel_rad" if is_road_wheel else "steer_rad"],
        is_road_wheel,
        tuple(Signal(name, even[name]) for name in COMPARED if name in even),
    )


def _times_s(log: LogFile, column: Column | None, log_period_s: float | None) -> Array:
    """Times from the beginning of the log.

    Raises:
        ConfigError: there is neither a column nor a period, or both; or the time does not increase.
    """
    if (column is None) == (log_period_s is None):
        found = "neither" if column is None else "both"
        raise ConfigError(
            f"{log.path}: expected either a column of times, named by --column time_s=COLUMN, or "
            f"the period of the log by --period-s, found {found}."
        )
    if column is None:
        n = len(log.columns[0]) if log.columns else 0
        return (log_period_s or 0.0) * np.arange(n, dtype=np.float64)
    recorded_s = column.factor * log.column(column.title)
    steps_s = np.diff(recorded_s)
    wrong = np.flatnonzero(~(steps_s > 0.0))
    if len(wrong):
        k = int(wrong[0])
        raise ConfigError(
            f"{log.path}: column {column.title}: expected times that increase, found "
            f"{recorded_s[k]:.6f} s and then {recorded_s[k + 1]:.6f} s in sample {k + 2}, and "
            f"{len(wrong)} such samples. Sort the log and remove repeated samples."
        )
    gaps = np.flatnonzero(steps_s > _LONGEST_GAP_S)
    if len(gaps):
        k = int(gaps[0])
        raise ConfigError(
            f"{log.path}: column {column.title}: expected no gap above {_LONGEST_GAP_S} s, found "
            f"{steps_s[k]:.3g} s at {recorded_s[k] - recorded_s[0]:.6g} s. Is its unit right? Cut "
            f"the log there."
        )
    times_s: Array = recorded_s - recorded_s[:1]
    return times_s


def _require_numbers(path: Path, time_s: Array, columns: Sequence[tuple[str, Array]]) -> None:
    problems = []
    for title, values in columns:
        wrong = ~np.isfinite(values)
        if wrong.any():
            k = int(np.argmax(wrong))
            problems.append(
                f"column {title}: expected numbers, found {values[k]} at {time_s[k]:.6g} s, and "
                f"{np.count_nonzero(wrong)} such samples."
            )
    if problems:
        problems[-1] += " Fill them, or use the part before or after by --from-s and --to-s."
        raise ConfigError(f"{path}:\n  " + "\n  ".join(problems))


def _require_driving(path: Path, time_s: Array, speed_mps: Array) -> None:
    if speed_mps.max() > FASTEST_START_MPS:
        raise ConfigError(
            f"{path}: expected speeds up to {FASTEST_START_MPS:g} m/s, found "
            f"{speed_mps.max():.4g} m/s. Is the column in km/h? Then name it by --column "
            f"vx_kmh=COLUMN."
        )
    slow = speed_mps < LEAST_SPEED_MPS
    if not slow.any():
        return
    begin, end = _longest_run(~slow)
    remedy = (
        f"The longest part above is --from-s {time_s[begin]:.2f} --to-s {time_s[end]:.2f}."
        if end > begin
        else "No part of it is above. Is the sign of the speed right?"
    )
    k = int(np.argmax(slow))
    raise ConfigError(
        f"{path}: expected a car that drives forward with at least {LEAST_SPEED_MPS:g} m/s, found "
        f"{speed_mps[k]:.3g} m/s at {time_s[k]:.6g} s. {remedy}"
    )


def _longest_run(among: np.ndarray) -> tuple[int, int]:
    """First and last index of the longest run of True; (0, 0) if there is none."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], among.astype(np.int8), [0]))))
    if not len(edges):
        return 0, 0
    begins, ends = edges[::2], edges[1::2] - 1
    k = int(np.argmax(ends - begins))
    return int(begins[k]), int(ends[k])
