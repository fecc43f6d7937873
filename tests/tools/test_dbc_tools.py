"""The tools that complete a DBC after a change: cycle times, and data ids of a new message."""

from pathlib import Path

import pytest

from rt_controller.bus.dbc import DBC_PATH
from rt_controller.contract.errors import ConfigError
from tools.cycle_times import with_cycle_times
from tools.data_ids import new_lines

TEXT = DBC_PATH.read_text(encoding="ascii")
LINE = next(line for line in TEXT.splitlines() if line.startswith('BA_ "E2EDataIdList" BO_ 312 '))


def test_cycle_times_in_the_dbc_are_replaced_by_those_of_the_period():
    outdated = TEXT.replace('"GenMsgCycleTime" BO_ 312 100;', '"GenMsgCycleTime" BO_ 312 7;')
    assert outdated != TEXT
    assert with_cycle_times(outdated) == TEXT


def written(folder: Path, text: str) -> Path:
    path = folder / "messages.dbc"
    path.write_text(text, encoding="ascii")
    return path


def test_a_message_without_data_ids_gets_a_line_that_passes_the_check(tmp_path):
    assert new_lines([DBC_PATH]) == []
    (line,) = new_lines([written(tmp_path, TEXT.replace(LINE, ""))])
    assert line.startswith('BA_ "E2EDataIdList" BO_ 312 "')
    assert new_lines([written(tmp_path, TEXT.replace(LINE, line))]) == []


def test_messages_of_another_dbc_on_the_same_bus_count(tmp_path):
    other = tmp_path / "other.dbc"
    other.write_text(TEXT.replace("Mode of the controller.", "Grad: °"), encoding="cp1252")
    with pytest.raises(ConfigError, match=r"ACT_CMD \(.*other.dbc\): .* as in ACT_CMD \(.*mess"):
        new_lines([DBC_PATH, other])
    other.write_text('VERSION ""\nBU_: A\nBO_ 9 X: 8 A\n', encoding="cp1252")
    assert new_lines([DBC_PATH, other]) == []


@pytest.mark.parametrize(
    ("counter", "data_id", "objection"),
    [
        (3, 0xD5, "D5 under counter 3, as in ACT_CMD"),
        (1, 0x29, "29 and 62 under the counters 1 and 5"),
    ],
)
def test_a_data_id_that_breaks_a_rule_is_reported(tmp_path, counter, data_id, objection):
    ids = bytearray.fromhex(LINE.split('"')[3])
    ids[counter] = data_id
    text = TEXT.replace(LINE, f'BA_ "E2EDataIdList" BO_ 312 "{ids.hex(" ")}";')
    with pytest.raises(ConfigError, match=rf"MISSION .*{objection}(?s:.*)Delete the lines"):
        new_lines([written(tmp_path, text)])
