"""`offline-import` on logs of the made car, in a folder of a test."""

import numpy as np
from made_logs import MAPPING, make_drive, rounded, write_csv

from offline.commands.import_logs import app as import_app


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
