"""The command of the figures: stored parts, imported files, tables between markers."""

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.figures import __main__ as figures
from benchmarks.figures import closed_loop
from benchmarks.figures.closed_loop import ROWS, Controller, Row, scenario_of
from benchmarks.figures.results import Part, Results, hashes_of, read_import
from benchmarks.figures.tables import TABLES, by_controller, by_name
from rt_controller import simulate
from rt_controller.contract.errors import ConfigError
from rt_controller.terminal.command_line import run_command

NAMES = [each.name for each in closed_loop.parts()]
DRIVE = {"ey_rms_m": 0.0164, "ey_peak_m": 0.0436, "stop_s": None}
MARKER = "Before.\n\n<!-- figures: lateral_error -->\n<!-- end -->\n\nAfter.\n"


def drive_parts(measured: list[str], failing: str = "") -> list[Part]:
    """Made parts for every row with every model; `measured` notes their order."""

    def part(name: str) -> Part:
        def measure() -> dict[str, Any]:
            if name == failing:
                raise KeyboardInterrupt
            measured.append(name)
            return {**DRIVE, "speed_rms_mps": 0.02, "wheel_rate_rms_degps": 12.0,
                    "speed_peak_mps": 0.1, "ey_settled_m": 0.01, "stop_error_m": 0.01,
                    "creep_m": 0.002, "mode_changes": 5, "pedal_changes": 3}  # fmt: skip

        return Part(name, ("lti",), measure)

    return [part(name) for name in NAMES]


def run(root: Path, *options: str) -> int:
    with pytest.raises(SystemExit) as ended:
        run_command(figures.app, ["--root", str(root), "--jobs", "1", *options])
    assert isinstance(ended.value.code, int)
    return ended.value.code


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "docs").mkdir()
    (tmp_path / "README.md").write_text(MARKER)
    return tmp_path


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    names: list[str] = []
    monkeypatch.setattr(closed_loop, "parts", lambda: drive_parts(names))
    return names


def test_a_table_is_made_between_its_markers_and_a_changed_number_is_found(root, measured, capsys):
    assert run(root) == 0
    text = (root / "README.md").read_text()
    assert "| lane change, 80 km/h | 0.016, 0.044 | 0.016, 0.044 |" in text
    assert text.startswith("Before.\n")
    assert text.endswith("\nAfter.\n")
    assert run(root, "--check") == 0
    assert "checked 1 tables in 1 files" in capsys.readouterr().err
    (root / "README.md").write_text(text.replace("0.016, 0.044", "0.015, 0.044", 1))
    assert run(root, "--check") == 1
    assert "README.md: differs from the results" in " ".join(capsys.readouterr().err.split())
    assert run(root, "--tables") == 0
    assert (root / "README.md").read_text() == text


def test_a_stopped_run_goes_on_where_it_was(root, measured, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr(closed_loop, "parts", lambda: drive_parts(measured, failing=NAMES[2]))
        assert run(root) == 130
    assert (root / "README.md").read_text() == MARKER
    assert run(root, "--check") == 1
    assert run(root) == 0
    assert measured == NAMES
    assert run(root, "--again") == 0
    assert measured == NAMES * 2


def test_a_part_of_another_model_is_missing(tmp_path):
    file = tmp_path / "figures.json"
    (part,) = parts = [Part("a", ("lti",), dict)]
    results = Results(file)
    results.put("piece", part, {"x_m": 1.0})
    assert not Results(file).missing("piece", parts)
    stored = json.loads(file.read_text())
    stored["piece"]["a"]["models_sha256"]["lti"] = "0" * 64
    file.write_text(json.dumps(stored))
    assert Results(file).missing("piece", parts) == parts


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("<!-- figures: beauty -->\n<!-- end -->\n", "found beauty"),
        ("<!-- figures: a -->\n", "one without an end"),
        ("<!-- figures: a -->\n\n<!-- figures: a -->\n<!-- end -->\n", "one without an end"),
    ],
)
def test_a_marker_without_a_table_or_an_end_is_refused(text, expected):
    with pytest.raises(ConfigError, match=expected):
        figures.replace_blocks(text, {"a": "x"}, "README.md")


def test_a_safe_stop_is_marked_and_a_drive_that_was_not_made_is_empty():
    drives = {"lti: a": DRIVE, "mdk-net: a": {**DRIVE, "stop_s": 3.0}}
    table = by_controller(drives, "{ey_rms_m}", "ab", ("lti", "mdk-net"))
    assert table.splitlines()[2:] == ["| a | 0.0164 | 0.0164, stopped |", "| b |  |  |"]


def test_a_file_of_another_command_is_imported_under_its_piece(root):
    alarms = {
        "driven_h": 10.01, "drives": 1820, "drives_with_false_alarm": 0,
        "drives_that_lose_the_path_without_checks_too": 17, "false_alarms": [],
        "drives_that_lose_the_path_where_stanley_keeps_it": 2,
        "checks": [{"check": "path", "largest_share_of_threshold": 0.5,
                    "drives_with_false_alarm": 0}],
    }  # fmt: skip
    file = root / "alarms.json"
    file.write_text(json.dumps(alarms))
    (root / "README.md").write_text(MARKER.replace("lateral_error", "false_alarms"))
    assert run(root, "--tables", "--import", str(file)) == 0
    assert "\n0 of 1,820 drives had a false alarm" in (root / "README.md").read_text()
    file.write_text("{}")
    assert run(root, "--tables", "--import", str(file)) == 2


def test_an_evaluation_of_another_model_is_refused(tmp_path):
    file = tmp_path / "evaluation.json"
    file.write_text(json.dumps({"parts": [], "rows": [], "model_sha256": {"mdk-net": "0"}}))
    with pytest.raises(ConfigError, match="found those of another model"):
        read_import(file)


def test_every_row_is_a_scenario_that_is_judged_by_the_car_itself():
    for row in ROWS:
        assert scenario_of(row).metrics[0] == "ey_rms_m"
    assert len({row.name for row in ROWS}) == len(ROWS)
    stops = {scenario_of(row).stops[0].deceleration_mps2 for row in ROWS if row.has_stop}
    assert stops == {1.0, 1.4, 1.8, 2.5}


def test_the_figures_of_a_drive_have_its_settled_offset_and_its_stop(tmp_path):
    scenario = tmp_path / "stop.toml"
    scenario.write_text(
        'format = 2\nname = "short stop"\nduration_s = 4.0\nreference.speed_kmh = 9.0\n'
        "[[stops]]\nat_s_m = 4.0\nhold_s = 5.0\ndeceleration_mps2 = 1.5\n"
    )
    controller = Controller(lambda scenario, plant: simulate(scenario, model="lti", plant=plant))
    row = Row("stop", str(scenario), settled_s=1.0, has_stop=True)
    found = closed_loop.measure_drive(controller, row)
    assert found["stop_s"] is None
    assert abs(found["stop_error_m"]) < 0.2
    assert abs(found["ey_settled_m"]) <= found["ey_peak_m"] + 1e-3
    assert found["mode_changes"] >= 2  # low speed, standstill, STANDBY


RATIO = {"over_reference": 2.0, "over_reference_low": 1.0, "over_reference_high": 3.0}
EVALUATION = {
    "reference": "mdk-net",
    "parts": [
        {"part": "library", "is_whole_set": True, "trajectories": 9, "best_linear": "lti"},
        {"part": "library, slow", "is_whole_set": False, "best_linear": "lti"},
    ],
    "rows": [
        {"part": "library", "model": model, "state": state, "unit": unit, "mse": 0.156, **RATIO}
        for model in ("mdk-net", "lti")
        for state, unit in (("vx", "km/h"), ("geometric_mean", ""))
    ],
}


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("mse", "| mdk-net | 0.156 |"),
        ("mse_ratios", "| lti | 2 | 2 (1 to 3) |"),
        ("mse_sets", "| library | 9 | lti | 2 | 2 (1 to 3) |"),
    ],
)
def test_the_file_of_an_evaluation_becomes_tables(tmp_path, name, line):
    hashes = hashes_of(("mdk-net",))
    file = tmp_path / "found.json"
    file.write_text(json.dumps({**EVALUATION, "model_sha256": hashes}))
    piece, part = read_import(file)
    assert piece == TABLES[name][0]
    assert line in by_name(part.measure(), name, "name").splitlines()
