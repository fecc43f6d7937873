"""Tools of cantools and python-can read what a drive recorded, and play it to any bus."""

import io
import sys
from pathlib import Path

import can.player
import cantools
import pytest

from rt_controller.bus.dbc import DBC_PATH
from rt_controller.bus.messages import STATE, Node
from rt_controller.bus.receive import Inbox
from rt_controller.bus.transport import close_bus, open_bus


def test_cantools_decode_names_every_frame_of_a_log(
    recorded_log: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["cantools", "decode", "--single-line", str(DBC_PATH)])
    monkeypatch.setattr(sys, "stdin", io.StringIO(recorded_log.read_text()))
    cantools._main()
    decoded = capsys.readouterr().out.splitlines()
    assert len(decoded) == len(recorded_log.read_text().splitlines())
    assert sum("STATE_A(" in line for line in decoded) > 70
    assert not [line for line in decoded if "Unknown" in line]


def test_cantools_plot_draws_a_log(
    recorded_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib").use("Agg")
    picture = tmp_path / "speed.svg"
    arguments = ["plot", "-o", str(picture), str(DBC_PATH), "STATE_A.VelocityX"]
    monkeypatch.setattr(sys, "argv", ["cantools", *arguments])
    monkeypatch.setattr(sys, "stdin", io.StringIO(recorded_log.read_text()))
    cantools._main()
    assert "VelocityX" in picture.read_text()


@pytest.mark.parametrize("interface", ["virtual"])
def test_can_player_plays_a_log_to_a_bus(
    recorded_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, interface: str
) -> None:
    """It passes options to the interface that an own one has to accept."""
    states = [line for line in recorded_log.read_text().splitlines() if " 11" in line][:30]
    log = tmp_path / "states.log"
    log.write_text("\n".join(states) + "\n")
    bus = open_bus(interface, f"player-{tmp_path.name}")
    try:
        arguments = ["-i", interface, "-c", f"player-{tmp_path.name}", "--ignore-timestamps"]
        monkeypatch.setattr(sys, "argv", ["can_player", *arguments, str(log)])
        can.player.main()
        inbox = Inbox(Node.CONTROLLER)
        assert inbox.drain(bus, 0) == len(states)
        assert inbox.newest(STATE) is not None
    finally:
        close_bus(bus)
