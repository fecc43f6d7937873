"""Files and folders of logs."""

import hashlib

import pytest
from made_logs import MAPPING

from offline.logs.source import describe_source, find_logs
from rt_controller.contract.errors import ConfigError, DatasetError


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "logs"
    folder.mkdir()
    return folder


def fill(folder, *names):
    for name in names:
        (folder / name).write_text("")


def test_a_folder_gives_its_logs_in_order_and_nothing_else(folder, parse):
    fill(folder, "b.csv", "a.MF4", "c.csv.gz", "notes.md", "car.dbc")
    (folder / "older.csv").mkdir()
    found = [path.name for path in find_logs([folder], parse())]
    assert found == ["a.MF4", "b.csv", "c.csv.gz"]


def test_an_empty_folder_is_refused(folder, parse):
    fill(folder, "notes.md")
    with pytest.raises(DatasetError, match=r"logs: expected logs .* found a folder without any"):
        find_logs([folder], parse())


def test_what_is_not_there_or_of_no_known_kind_is_refused(folder, parse):
    fill(folder, "drive.xlsx")
    with pytest.raises(ConfigError, match=r"none\.csv: expected a log or a folder"):
        find_logs([folder / "none.csv"], parse())
    with pytest.raises(ConfigError, match=r"drive\.xlsx: expected a log of a known kind"):
        find_logs([folder / "drive.xlsx"], parse())


def test_two_logs_of_one_name_are_refused(folder, parse):
    (folder / "more").mkdir()
    fill(folder, "a.csv", "more/a.csv")
    with pytest.raises(ConfigError, match=r"found twice: a\.csv"):
        find_logs([folder, folder / "more"], parse())


def test_the_reference_line_beside_the_logs_is_no_log(folder, parse, tmp_path):
    fill(folder, "a.csv", "track.csv")
    pose = "".join(f'{n} = {{ column = "{n}", unit = "m" }}\n' for n in "xy")
    mapping = parse(
        MAPPING
        + f"[pose]\n{pose}"
        + 'yaw = { column = "yaw", unit = "rad" }\nreference_line = "logs/track.csv"\n'
    )
    assert [path.name for path in find_logs([folder], mapping)] == ["a.csv"]


def test_a_source_is_known_by_name_and_hash(folder):
    (folder / "a.csv").write_bytes(b"t,v\n")
    source = describe_source(folder / "a.csv")
    assert source.name == "a.csv"
    assert source.sha256 == hashlib.sha256(b"t,v\n").hexdigest()
