"""MCAP of a replayed drive has decoded signals with units, the plan and the cause of every tick."""

import json
import resource
from pathlib import Path
from typing import Any

import pytest
from virtual_drive import SHORT_LANE_CHANGE, Figures, drive

pytest.importorskip("foxglove")
reader = pytest.importorskip("mcap.reader")

from rt_controller.cli import app  # noqa: E402
from rt_controller.contract.errors import ConfigError  # noqa: E402

Messages = dict[str, list[tuple[int, dict[str, Any]]]]
LAYOUT = Path(__file__).parents[2] / "deploy" / "foxglove-layout.json"
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


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Figures]:
    """The log of a drive, and its summary."""
    folder = tmp_path_factory.mktemp("recorded")
    log = folder / "run.log"
    return log, drive(folder, "lti", "--scenario", SHORT_LANE_CHANGE, "--record", str(log))


def convert(log: Path, file: Path) -> int:
    code: int = app.meta(["replay", str(log), "--mcap", str(file)], result_action="return_value")
    return code


def test_a_drive_is_written_with_units_plan_and_cause(recorded, tmp_path):
    (log, figures), path = recorded, tmp_path / "run.mcap"
    assert convert(log, path) == 0
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


def test_an_existing_file_is_not_replaced_unasked(recorded, tmp_path):
    path = tmp_path / "run.mcap"
    path.write_text("of another drive")
    with pytest.raises(ConfigError, match="expected no file of that name yet"):
        convert(recorded[0], path)
    assert path.read_text() == "of another drive"


def test_a_full_disk_is_reported(recorded, tmp_path, capfd):
    """foxglove-sdk itself only prints a failed write."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))  # EFBIG in place of ENOSPC
    try:
        convert(recorded[0], tmp_path / "full.mcap")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert "full.mcap: expected room for the file, found File too large" in capfd.readouterr().err


def test_the_layout_for_foxglove_names_only_what_the_file_has(recorded, tmp_path):
    path = tmp_path / "run.mcap"
    convert(recorded[0], path)
    _, schemas = read(path)
    layout = json.loads(LAYOUT.read_text())
    panels = layout["configById"]
    shown = [each["value"] for panel in panels.values() for each in panel.get("paths", ())]
    for name in shown:
        topic, field = name.split(".")
        assert field in schemas[topic], name
    assert {panel["topicPath"] for panel in panels.values() if "topicPath" in panel} <= {*schemas}
    assert len(shown) > 10
    assert all(f'"{panel}"' in json.dumps(layout["layout"]) for panel in panels)
