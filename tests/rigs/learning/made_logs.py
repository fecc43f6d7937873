"""Drives of a simple simulated car, made in milliseconds, and logs of them."""

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from offline.commands.import_logs import app as import_app
from offline.logs.episode import LogEpisode
from offline.logs.readers.log import Log, LogColumn

WHEELBASE_M = 2.7
MASS_KG = 1500.0

MAPPING = """
[time]
column = "time"

[states]
vx_mps = { column = "speed", unit = "m/s" }
vy_mps = { column = "side", unit = "m/s" }
yaw_rate_radps = { column = "turn", unit = "rad/s" }

[inputs]
road_wheel_rad = { column = "wheel", unit = "rad" }
force_n = { column = "force", unit = "N" }
"""

POSE = """
[pose]
x = { column = "x", unit = "m" }
y = { column = "y", unit = "m" }
yaw = { column = "yaw", unit = "rad" }
"""
"""appended to a mapping"""


class Made(NamedTuple):
    """A drive in SI, (T,) each."""

    time: np.ndarray
    speed: np.ndarray
    side: np.ndarray
    turn: np.ndarray
    wheel: np.ndarray
    force: np.ndarray
    x: np.ndarray
    y: np.ndarray
    yaw: np.ndarray


def make_drive(duration_s=30.0, dt_s=0.01, seed=0) -> Made:
    """A drive whose yaw rate follows the wheel with a lag of 0.1 s, and speed the force."""
    rng = np.random.default_rng(seed)
    t = dt_s * np.arange(round(duration_s / dt_s) + 1)
    hz, phase = (0.15, 0.4, 0.9), rng.uniform(0, 2 * np.pi, (2, 3))
    wheel = 0.02 * sum(np.sin(2 * np.pi * f * t + p) for f, p in zip(hz, phase[0], strict=True))
    force = 700 * sum(np.sin(2 * np.pi * f * t + p) for f, p in zip(hz, phase[1], strict=True))
    made = np.zeros((len(t), 6))
    v, r, x, y, yaw = 15.0 + rng.uniform(-2, 2), 0.0, 0.0, 0.0, 0.0
    for k in range(len(t)):
        made[k] = v, 0.4 * r, r, x, y, yaw
        x += dt_s * (v * np.cos(yaw) - 0.4 * r * np.sin(yaw))
        y += dt_s * (v * np.sin(yaw) + 0.4 * r * np.cos(yaw))
        yaw += dt_s * r
        r += dt_s / 0.1 * (v * wheel[k] / WHEELBASE_M - r)
        v += dt_s * force[k] / MASS_KG
    speed, side, turn, x, y, yaw = made.T
    return Made(t, speed, side, turn, wheel, force, x, y, yaw)


def write_csv(path: Path, columns) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return path


def rounded(made: Made) -> dict[str, list]:
    """The columns of a log as lists that a test may change."""
    return {name: np.round(values, 7).tolist() for name, values in made._asdict().items()}


def episode_of(made: Made, file="a.csv") -> LogEpisode:
    """The drive as one episode with the signals of `MAPPING` and poses."""
    signals = {
        "vx_mps": made.speed,
        "vy_mps": made.side,
        "yaw_rate_radps": made.turn,
        "road_wheel_rad": made.wheel,
        "force_n": made.force,
    }
    pose = np.stack([made.x, made.y, made.yaw], axis=1)
    return LogEpisode(file, 0.0, pd.DataFrame(signals), pose)


def log_of(t_s, columns, file="a.csv", unit=None) -> Log:
    """A log of these columns, its rows counted from 1."""
    rows = np.arange(1, len(t_s) + 1)
    made = tuple(LogColumn(name, t_s, v, rows, unit, Path(file)) for name, v in columns.items())
    return Log(file, made, len(rows))


def signal_of(drive, name):
    """The signal of that name."""
    return next(signal for signal in drive.all_signals if signal.name == name)


def make_place(folder):
    """The folder with three logs of 15 s and a mapping."""
    (folder / "logs").mkdir()
    for seed in range(3):
        change_log(folder, seed)
    (folder / "map.toml").write_text(MAPPING)
    return folder


def columns_of(seed):
    """The columns of one log."""
    return rounded(make_drive(15.0, 0.01, seed))


def change_log(place, seed=1, **changes):
    """Write one log, its columns changed by these functions."""
    columns = columns_of(seed)
    for name, change in changes.items():
        columns[name] = change(np.array(columns[name])).tolist()
    write_csv(place / "logs" / f"run_{seed}.csv", columns)


def run_import(place, *options):
    """Exit code of the command with the mapping and the logs of the folder."""
    tokens = [str(place / "map.toml"), str(place / "logs"), *map(str, options)]
    return import_app(tokens, result_action="return_value") or 0
