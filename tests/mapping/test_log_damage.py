"""A damaged log is described by the place of the damage, in words of its format."""

from pathlib import Path

import can
import pytest

from rt_controller.mapping.log_damage import explain_damage, is_candump_line


@pytest.mark.parametrize(
    "line",
    [
        "(1.000000) can0 123#",
        "(1.000000) can0 00000123#0102 R\n",
        "(1.000000) can0 123##10102",
        "(1.000000) can0 123#R8",
        "(1.000000) can0 20000004#0000000000000000",
    ],
)
def test_lines_of_candump_are_whole(line: str) -> None:
    assert is_candump_line(line)


@pytest.mark.parametrize(
    "line", ["(17", "(1.0) can0", "(x) can0 123#00", "(1.0) can0 123#ZZ", "(1.0) can0 123#012"]
)
def test_a_damaged_line_of_candump_is_named_with_its_number(tmp_path: Path, line: str) -> None:
    log = tmp_path / "a.log"
    log.write_text(f"(1.0) can0 123#00\n\n{line}\n")
    expected = r"(seconds) channel ID#DATA with ID and DATA in hexadecimal digits"
    assert explain_damage(log, 1) == f"{log}, line 3: expected {expected}, found {line!r}"


def test_a_damaged_log_of_another_format_is_named_with_the_frame(tmp_path: Path) -> None:
    log = tmp_path / "a.asc"
    with can.ASCWriter(log) as writer:
        for number in range(3):
            writer.on_message_received(can.Message(timestamp=number, data=[number]))
    log.write_text(log.read_text().replace(" 02\n", " ZZ\n"))
    n_frames = 0
    with pytest.raises(ValueError, match="ZZ"), can.LogReader(log) as reader:  # noqa: PT012
        for _ in reader:
            n_frames += 1
    assert f"{log}, frame 3: expected a frame in the format .asc" in explain_damage(log, n_frames)


def test_a_log_without_any_frame_is_no_log_of_its_format(tmp_path: Path) -> None:
    log = tmp_path / "a.blf"
    log.write_bytes(b"text")
    assert "expected a CAN log in the format of its suffix" in explain_damage(log, 0)
