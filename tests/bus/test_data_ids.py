"""Data ids are chosen and checked by the three rules of `data_ids`."""

from pathlib import Path

import pytest

from rt_controller.bus.codec import crc8
from rt_controller.bus.data_ids import choose, find_objections, new_lines
from rt_controller.bus.dbc import DBC_PATH
from rt_controller.contract.errors import ConfigError

TEXT = DBC_PATH.read_text(encoding="ascii")
LINE = next(line for line in TEXT.splitlines() if line.startswith('BA_ "E2EDataIdList" BO_ 312 '))


def written(folder: Path, text: str) -> Path:
    path = folder / "messages.dbc"
    path.write_text(text, encoding="ascii")
    return path


def with_ids(ids: bytes) -> str:
    return TEXT.replace(LINE, f'BA_ "E2EDataIdList" BO_ 312 "{ids.hex(" ")}";')


def ids_of_mission() -> bytearray:
    return bytearray.fromhex(LINE.split('"')[3])


def test_the_shipped_data_ids_obey_all_rules() -> None:
    assert new_lines([DBC_PATH]) == []


def test_a_message_without_data_ids_gets_a_line_that_passes_the_check(tmp_path: Path) -> None:
    (line,) = new_lines([written(tmp_path, TEXT.replace(LINE, ""))])
    assert line.startswith('BA_ "E2EDataIdList" BO_ 312 "')
    assert new_lines([written(tmp_path, TEXT.replace(LINE, line))]) == []


@pytest.mark.parametrize(
    ("counter", "data_id", "objection"),
    [
        (3, 0xD5, "D5 under counter 3, as in ACT_CMD"),
        (1, 0x29, "29 and 62 under the counters 1 and 5"),
    ],
)
def test_a_data_id_that_breaks_a_rule_is_reported(
    tmp_path: Path, counter: int, data_id: int, objection: str
) -> None:
    ids = ids_of_mission()
    ids[counter] = data_id
    with pytest.raises(ConfigError, match=rf"MISSION .*{objection}(?s:.*)Delete the lines"):
        new_lines([written(tmp_path, with_ids(ids))])


@pytest.mark.parametrize(("counter", "byte"), [(0, 0x00), (15, 0xFF)])
def test_a_data_id_that_makes_a_dead_line_an_intact_frame_is_reported(
    counter: int, byte: int
) -> None:
    (data_id,) = (each for each in range(256) if crc8(bytes([byte] * 8), each) == byte)
    ids = bytearray(choose("NEW", {}))
    ids[counter] = data_id
    assert any(f"eight 0x{byte:02X} are intact" in text for text in find_objections({"NEW": ids}))


def test_messages_of_another_dbc_on_the_same_bus_count(tmp_path: Path) -> None:
    other = tmp_path / "other.dbc"
    other.write_text(TEXT.replace("Mode of the controller.", "Grad: °"), encoding="cp1252")
    with pytest.raises(ConfigError, match=r"ACT_CMD \(.*other.dbc\): .* as in ACT_CMD \(.*mess"):
        new_lines([DBC_PATH, other])
    other.write_text('VERSION ""\nBU_: A\nBO_ 9 X: 8 A\n', encoding="cp1252")
    assert new_lines([DBC_PATH, other]) == []


def test_a_file_that_does_not_exist_is_named_with_a_remedy_that_fits(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"radar\.dbc: expected a DBC file.*name another"):
        new_lines([tmp_path / "radar.dbc"])
