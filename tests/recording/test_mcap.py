"""MCAP has decoded signals with units, the plan and the cause of every tick."""

import json
import os
from pathlib import Path
from threading import Event, Thread
from typing import Any

import pytest
from virtual_drive import SHORT_LANE_CHANGE, drive

pytest.importorskip("foxglove")
reader = pytest.importorskip("mcap.reader")

from rt_controller.bus.log.recorder import RecordedFrame  # noqa: E402
from rt_controller.cli import app  # noqa: E402
from rt_controller.contract.errors import ConfigError  # noqa: E402
from rt_controller.recording.mcap import McapSink  # noqa: E402

Messages = dict[str, list[tuple[int, dict[str, Any]]]]
FRAMES = [
    RecordedFrame(stamp_ns, False, 0x110, False, False, False, False, bytes(8))
    for stamp_ns in range(3000)
]
"""more than fit into one chunk of MCAP"""


TYPES = {"number": (int, float), "string": str}


def require_described(content: dict[str, Any], schema: dict[str, Any]) -> None:
    """A reader that knows only the schema finds every field, with the type that it expects."""
    assert schema["type"] == "object"
    for name, value in content.items():
        described = schema["properties"][name]
        values = value if described["type"] == "array" else [value]
        expected = described["items"] if described["type"] == "array" else described
        assert all(isinstance(each, TYPES[expected["type"]]) for each in values), (name, value)


def read(path: Path) -> tuple[Messages, dict[str, dict[str, Any]]]:
    """Log time and content of each topic, and the schemas."""
    messages: Messages = {}
    schemas: dict[str, dict[str, Any]] = {}
    with path.open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
            content = json.loads(message.data)
            require_described(content, json.loads(schema.data))
            messages.setdefault(channel.topic, []).append((message.log_time, content))
            schemas[channel.topic] = json.loads(schema.data)["properties"]
    return messages, schemas


def test_a_drive_is_written_with_units_plan_and_cause(tmp_path: Path) -> None:
    path, log = tmp_path / "run.mcap", tmp_path / "run.log"
    files = ("--mcap", str(path), "--record", str(log))
    figures = drive(tmp_path, "lti", "--scenario", SHORT_LANE_CHANGE, *files)
    messages, schemas = read(path)
    ticks = [content for _, content in messages["/controller"]]
    assert [tick["tick"] for tick in ticks] == list(range(figures["ticks"]))
    assert {tick["mode"] for tick in ticks} == {"NOMINAL", "STANDBY"}
    assert {tick["cause"] for tick in ticks} == {"NONE"}
    assert schemas["/state"]["vx_mps"]["description"] == "m/s"
    assert schemas["/can/STATE_A"]["VelocityX"]["description"] == "m/s"
    time_ns, state = messages["/state"][20]
    received = dict(messages["/can/STATE_A"])[time_ns]
    assert received["VelocityX"] == pytest.approx(state["vx_mps"])
    plan = dict(messages["/plan"])[time_ns]
    control = dict(messages["/controller"])[time_ns]
    assert plan["steer_rad"][0] == pytest.approx(control["steer_rad"])
    assert len(plan["ey_m"]) == len(plan["time_s"]) == len(plan["throttle"]) + 1
    assert plan["vx_mps"][0] == pytest.approx(state["vx_mps"], abs=0.05)  # two periods later
    again = tmp_path / "again.mcap"
    assert app.meta(["replay", str(log), "--mcap", str(again)], result_action="return_value") == 0
    assert read(again)[0]["/plan"] == messages["/plan"]
    assert read(again)[0]["/state"] == messages["/state"]


def test_an_existing_file_is_not_replaced_unasked(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_text("of another drive")
    with pytest.raises(ConfigError, match="expected no log of that name yet"):
        McapSink(path)
    assert path.read_text() == "of another drive"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_disk_is_reported_while_the_drive_goes_on(
    capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    """foxglove-sdk itself only prints a failed write."""
    sink = McapSink(Path("/dev/full"))
    for _ in range(2):
        sink.append(FRAMES, len(FRAMES))
        assert "No space left" in sink.failure
    sink.close()
    assert "No space left" in sink.failure
    assert (capfd.readouterr().err, caplog.messages) == ("", [])


def test_a_disk_that_stalls_holds_up_no_other_thread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The interpreter lock is free while the writer waits; the test would hang otherwise."""
    is_stalled, answers = Event(), Event()
    write = os.write

    def stall(descriptor: int, data: bytes) -> int:
        is_stalled.set()
        assert answers.wait(60.0)
        return write(descriptor, data)

    monkeypatch.setattr("rt_controller.bus.log.log_file.os.write", stall)
    sink = McapSink(tmp_path / "run.mcap")
    writer = Thread(target=sink.append, args=(FRAMES, len(FRAMES)))
    writer.start()
    assert is_stalled.wait(60.0)
    answers.set()
    writer.join()
    sink.close()
    assert sink.failure == ""
    assert len(read(tmp_path / "run.mcap")[0]["/can/STATE_A"]) == len(FRAMES)
