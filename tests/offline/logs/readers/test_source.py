"""Logs are found in files and folders by their endings."""

import hashlib

import pytest
from made_logs import MAPPING

from offline.logs.readers.source import find_logs, source_file
from rt_controller.contract.errors import ConfigError, DatasetError


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "logs"
    folder.mkdir()
    return folder


def fill(folder, *names):
    for name in names:
        (folder / name).write_text("")


def test_a_folder_gives_only_its_logs_sorted_by_name(folder, parse):
    fill(folder, "b.csv", "a.MF4", "c.csv.gz", "notes.md", "car.dbc")
    (folder / "older.csv").mkdir()
    found = [drive.name for drive in find_logs([folder], parse())]
    assert found == ["a.MF4", "b.csv", "c.csv.gz"]


def test_an_empty_folder_is_refused(folder, parse):
    fill(folder, "notes.md")
    with pytest.raises(DatasetError, match=r"logs: expected logs .* found a folder without any"):
        find_logs([folder], parse())


def test_a_missing_file_and_an_unknown_ending_are_refused(folder, parse):
    fill(folder, "drive.xlsx")
    with pytest.raises(ConfigError, match=r"none\.csv: expected a log or a folder"):
        find_logs([folder / "none.csv"], parse())
    with pytest.raises(ConfigError, match=r"drive\.xlsx: expected a log of a known kind"):
        find_logs([folder / "drive.xlsx"], parse())


def test_two_logs_with_the_same_name_are_refused(folder, parse):
    (folder / "more").mkdir()
    fill(folder, "a.csv", "more/a.csv")
    with pytest.raises(ConfigError, match=r"found twice: a\.csv"):
        find_logs([folder, folder / "more"], parse())


def test_a_reference_line_in_the_folder_is_not_a_log(folder, parse, tmp_path):
    fill(folder, "a.csv", "track.csv")
    pose = "".join(f'{n} = {{ column = "{n}", unit = "m" }}\n' for n in "xy")
    mapping = parse(
        MAPPING
        + f"[pose]\n{pose}"
        + 'yaw = { column = "yaw", unit = "rad" }\nreference_line = "logs/track.csv"\n'
    )
    assert [drive.name for drive in find_logs([folder], mapping)] == ["a.csv"]


def test_a_source_file_has_name_and_hash(folder):
    (folder / "a.csv").write_bytes(b"t,v\n")
    source = source_file(folder / "a.csv", "a.csv")
    assert source.name == "a.csv"
    assert source.sha256 == hashlib.sha256(b"t,v\n").hexdigest()
