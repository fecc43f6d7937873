"""Drives with one file for each signal become the same data set as one table for each drive."""

import numpy as np
import pytest
from made_logs import MAPPING, change_log, make_drive, run_import, write_csv

from offline.data.dataset import load_dataset
from offline.data.manifest import Imported, read_manifest
from rt_controller.contract.errors import ConfigError, DatasetError

SIGNALS = ("speed", "side", "turn", "wheel", "force")


def mapping_of(file, column="value", time='column = "time"'):
    """The mapping of the made logs with a file for each signal; `{}` in `file` is the signal."""
    text = MAPPING.replace('column = "time"', time)
    for name in SIGNALS:
        text = text.replace(
            f'column = "{name}"', f'file = "{file.replace("{}", name)}", column = "{column}"'
        )
    return text


def parts_of(seed, begin_s=0.0):
    """Name, times and values of each signal of a drive; every signal has its own rate."""
    made = make_drive(15.0, 0.01, seed)
    for k, name in enumerate(SIGNALS):
        rows = slice(3 * k, None, 1 + k % 2)
        yield name, begin_s + made.time[rows], getattr(made, name)[rows]


def write_parts(place, file, begin_s=0.0):
    """Three drives with a file of times and values for each signal."""
    for seed in range(3):
        for name, t_s, values in parts_of(seed, begin_s):
            named = file.replace("{}", name).replace("{drive}", f"run_{seed}")
            path = place / "logs" / (named if "{drive}" in file else f"run_{seed}/{named}")
            path.parent.mkdir(parents=True, exist_ok=True)
            write_csv(path, {"time": t_s.tolist(), "value": values.tolist()})


@pytest.fixture
def place(tmp_path):
    (tmp_path / "logs").mkdir()
    return tmp_path


@pytest.mark.parametrize(
    ("file", "begin_s"),
    [("can/{}.csv", 1.7e9), ("{drive}_{}.csv", 0.0), ("{drive}/{}-{drive}.csv", 0.0)],
)
def test_every_layout_of_files_gives_the_same_numbers_as_a_table(place, file, begin_s):
    for seed in range(3):
        change_log(place, seed)
    (place / "map.toml").write_text(MAPPING)
    run_import(place, "--data", place / "table")
    for log in (place / "logs").iterdir():
        log.unlink()
    write_parts(place, file, begin_s)
    (place / "map.toml").write_text(mapping_of(file))
    run_import(place, "--data", place / "parts")
    table, parts = (load_dataset(place / name).recording for name in ("table", "parts"))
    # Every signal begins later by some samples, so the files have 0.12 s less in common.
    begin = round(0.12 / 0.025)
    assert len(parts.x) == len(table.x) - 3 * (begin + 1)
    made = make_drive(15.0, 0.01, 0)
    at_s = 0.12 + 0.025 * np.arange(80)
    np.testing.assert_allclose(parts.x[:80, 2], np.interp(at_s, made.time, made.turn), atol=2e-3)
    origin = read_manifest(place / "parts" / "manifest.json").origin
    assert isinstance(origin, Imported)
    assert len({file.name for file in origin.files}) == 15


def test_arrays_with_the_times_in_another_array_are_read(place):
    for seed in range(3):
        for name, t_s, values in parts_of(seed):
            folder = place / "logs" / "route" / str(seed) / name
            folder.mkdir(parents=True)
            np.save(folder / "t.npy", 1e3 * t_s)
            np.save(folder / "value.npy", values[:, None])
    time = 'file = "t.npy"\ncolumn = "1"\nunit = "ms"'
    (place / "map.toml").write_text(mapping_of("{}/value.npy", "1", time))
    run_import(place, "--data", place / "data")
    assert len(load_dataset(place / "data").recording.first) == 3
    origin = read_manifest(place / "data" / "manifest.json").origin
    assert "route/0/speed/t.npy" in {file.name for file in origin.files}


def test_the_file_of_times_may_have_the_name_of_the_signal(place):
    for seed in range(3):
        folder = place / "logs" / str(seed)
        folder.mkdir()
        for name, t_s, values in parts_of(seed):
            np.savetxt(folder / f"{name}_time.txt", t_s)
            np.savetxt(folder / f"{name}.txt", values)
    time = 'file = "{name}_time.txt"\n[csv]\nheader_line = 0'
    (place / "map.toml").write_text(mapping_of("{}.txt", "1", time))
    assert run_import(place) == 0
    np.savetxt(place / "logs" / "1" / "turn_time.txt", np.arange(7.0))
    with pytest.raises(DatasetError, match=r"turn\.txt: expected a time for each of its 1495 rows"):
        run_import(place)


def test_columns_of_a_table_may_have_times_of_their_own(place):
    for seed in range(3):
        arrays = {}
        for name, t_s, values in parts_of(seed):
            arrays |= {name: values, f"{name}_t": t_s}
        np.savez(place / "logs" / f"run_{seed}.npz", **arrays)
    text = MAPPING.replace('column = "time"', "")
    for name in SIGNALS:
        own = f'column = "{name}", time = {{ column = "{name}_t" }}'
        text = text.replace(f'column = "{name}"', own)
    (place / "map.toml").write_text(text)
    assert run_import(place) == 0


def test_files_that_started_together_need_no_common_clock(place):
    write_parts(place, "{}.csv")
    for seed in range(3):
        name, t_s, values = next(parts_of(seed, begin_s=5e4))
        columns = {"time": t_s.tolist(), "value": values.tolist()}
        write_csv(place / "logs" / f"run_{seed}" / f"{name}.csv", columns)
    (place / "map.toml").write_text(mapping_of("{}.csv"))
    with pytest.raises(DatasetError, match=r"speed\.csv, .*begins 49985 s after the other ends"):
        run_import(place)
    together = 'column = "time"\nstarts_at_zero = true'
    (place / "map.toml").write_text(mapping_of("{}.csv", time=together))
    assert run_import(place) == 0


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (["a_turn.csv", "turn.csv"], r"run_1, .*one file \*turn\*\.csv, found 2 \(a_turn"),
        ([], r"run_1, .*one file \*turn\*\.csv, found none"),
    ],
)
def test_a_drive_that_lacks_a_file_or_has_two_is_refused_with_its_folder(place, files, message):
    write_parts(place, "{}.csv")
    (place / "map.toml").write_text(mapping_of("*{}*.csv"))
    (place / "logs" / "run_1" / "turn.csv").unlink()
    for name in files:
        write_csv(place / "logs" / "run_1" / name, {"time": [0], "value": [0]})
    with pytest.raises(DatasetError, match=message):
        run_import(place)


def test_a_folder_without_the_files_and_a_file_are_refused(place):
    (place / "map.toml").write_text(mapping_of("{}.csv"))
    with pytest.raises(DatasetError, match=r"logs: expected drives with the files speed\.csv, "):
        run_import(place)
    (place / "logs").rmdir()
    (place / "logs").write_text("")
    with pytest.raises(ConfigError, match="expected a folder, because `file`"):
        run_import(place)
