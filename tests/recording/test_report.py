"""`rt-controller report` writes one page about a recorded drive, or about two side by side."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from virtual_drive import SHORT_LANE_CHANGE, drive

from rt_controller.bus.log.recorder import journal_path
from rt_controller.cli import app
from rt_controller.contract.errors import ConfigError, DatasetError

FAULTS = """
[[faults]]
kind = "drop"
messages = ["STATE_B"]
start_s = 0.5
duration_s = 0.05

[[faults]]
kind = "bias"
signals = ["ey_m"]
value = 0.5
start_s = 1.0
"""


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a drive without faults; a second name of it needs no second drive."""
    folder = tmp_path_factory.mktemp("calm")
    drive(folder, "lti", "--scenario", SHORT_LANE_CHANGE, "--record", str(folder / "calm.log"))
    return folder / "calm.log"


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a drive that ends in a safe stop."""
    folder = tmp_path_factory.mktemp("stopped")
    faults, log = folder / "faults.toml", folder / "stopped.log"
    faults.write_text(FAULTS)
    command = "--bus virtual --pace lockstep --model lti --quiet --scenario"
    files = ("--faults", str(faults), "--record", str(log))
    arguments = [*command.split(), SHORT_LANE_CHANGE, *files, "--channel", "stopped"]
    assert app.meta(arguments, result_action="return_value") == 6
    return log


def report(folder: Path, *logs: Path) -> tuple[str, dict[str, Any]]:
    """The page and its figures."""
    page, figures = folder / "page.html", folder / "page.json"
    options = ("--output", str(page), "--json", str(figures), "--overwrite", "--quiet")
    arguments = ["report", *map(str, logs), *options]
    assert app.meta(arguments, result_action="return_value") == 0
    return page.read_text(), json.loads(figures.read_text())


def played_by(html: str) -> Any:
    """What the script of the page plays."""
    (found,) = re.findall(r'<script type="application/json">(.*?)</script>', html)
    return json.loads(found)


def test_an_untroubled_drive_says_so_with_its_errors_and_can_be_played(calm, tmp_path):
    html, figures = report(tmp_path, calm)
    (found,) = figures["drives"]
    assert re.match(
        r"The car followed its path within \d+ cm; no step was late", found["headline"][0]
    )
    assert found["headline"][0] in html
    assert (found["events"], found["notes"], found["ticks_with_other_command"]) == ([], [], 0)
    assert 0.0 < found["ey_rms_m"] < 0.2
    assert "Faults of calm.log: none." in html
    (played,) = played_by(html)["drives"]
    assert len(played["x"]) == len(played["time_s"]) == found["ticks"]
    assert played["x"][-1] > 40.0  # two seconds at 80 km/h
    assert len(played["horizons"]) > found["ticks"] / 6


def test_the_page_is_one_file_that_loads_nothing(calm, tmp_path):
    html, _ = report(tmp_path, calm)
    assert not re.findall(r'\b(?:src|href|srcset|data)="[^#]', html)
    for word in ("@import", "url(http", "<link", "<iframe", "fetch(", "import("):
        assert word not in html
    assert '<figure class="player" hidden>' in html  # until its script runs


def test_a_safe_stop_is_told_with_time_cause_remedy_and_its_faults(stopped, tmp_path):
    html, figures = report(tmp_path, stopped)
    (found,) = figures["drives"]
    verdict, why, *_ = found["headline"]
    assert verdict.startswith("The drive ended in a safe stop after")
    assert f"Safe stop at {found['stop_s']:.3f} s (tick {found['stop_tick']})" in why
    assert "Check what sends or measures these values" in why
    (failed,) = found["stop_checks"]
    assert (failed["check"], failed["value"] > failed["limit"]) == ("lateral error", True)
    held, lost = (
        next(event for event in found["events"] if event["name"] == name)
        for name in ("HOLD_PLAN", "STATE_STALE")
    )
    assert held["begin_s"] == lost["begin_s"] == pytest.approx(0.6, abs=0.1)
    assert lost["end_s"] - lost["begin_s"] == pytest.approx(0.05)
    assert found["events"][-1]["name"] == "SAFE_STOP"
    assert played_by(html)["drives"][0]["text"][-1].endswith("· SAFE_STOP")


def test_two_drives_share_the_page_with_the_difference_of_their_figures(calm, stopped, tmp_path):
    twin = _copy(stopped, tmp_path, calm.name)
    html, figures = report(tmp_path, calm, twin)
    first, second = figures["drives"]
    differences = figures["differences"]
    assert differences["ey_peak_m"] == pytest.approx(second["ey_peak_m"] - first["ey_peak_m"])
    assert differences["stop_s"] is None  # the first did not stop
    first_name, second_name = f"{calm.parent.name}/calm.log", f"{tmp_path.name}/calm.log"
    played = played_by(html)
    names = [each["name"] for each in played["drives"]]
    assert names == [first_name, f"{second_name}, as received"]
    assert played["mark"] == ["safe stop", pytest.approx(second["stop_s"])]
    assert "lateral error as received, RMS" in html
    with pytest.raises(ConfigError, match="expected different paths, found one of them twice"):
        report(tmp_path, calm, calm)


def _copy(log: Path, folder: Path, name: str | None = None) -> Path:
    copied = folder / (name or log.name)
    shutil.copy(log, copied)
    shutil.copy(journal_path(log), journal_path(copied))
    return copied


def test_a_log_that_ends_in_the_drive_says_so(calm, tmp_path, capsys):
    log = _copy(calm, tmp_path)
    lines = journal_path(log).read_text().splitlines(keepends=True)
    journal_path(log).write_text("".join(lines[:41]))
    _, figures = report(tmp_path, log)
    (found,) = figures["drives"]
    assert (found["ticks"], found["ending"]) == (40, "LOG_ENDED")
    assert re.match("The log ends while .*, cause unknown; until then", found["headline"][0])
    assert "on request" not in found["headline"][0]
    assert app.meta(["replay", str(log)], result_action="return_value") == 0
    assert "the log ends while the car was driven, cause unknown" in capsys.readouterr().err


def test_another_version_and_another_command_are_noted(calm, tmp_path):
    log = _copy(calm, tmp_path)
    text = journal_path(log).read_text().replace('"piqp":"', '"piqp":"0.0.')
    journal_path(log).write_text(re.sub(r'"control":\[\d', '"control":[9', text))
    html, figures = report(tmp_path, log)
    versions, commands = figures["drives"][0]["notes"]
    assert "piqp 0.0." in versions
    assert f"in {figures['drives'][0]['ticks']} ticks" in commands
    assert f"Note: {commands}"[:60] in html


@pytest.mark.parametrize(
    ("kept_lines", "kept_ticks", "expected"),
    [(100, None, "found fewer"), (None, None, "expected its journal"), (None, 1, "found no tick")],
)
def test_a_log_without_its_drive_is_refused(calm, tmp_path, kept_lines, kept_ticks, expected):
    log = _copy(calm, tmp_path)
    for file, kept in ((log, kept_lines), (journal_path(log), kept_ticks)):
        if kept is not None:
            file.write_text("".join(file.read_text().splitlines(keepends=True)[:kept]))
    if expected == "expected its journal":
        journal_path(log).unlink()
    with pytest.raises((ConfigError, DatasetError), match=expected):
        report(tmp_path, log)


def test_an_existing_page_is_not_replaced_unasked(calm, tmp_path):
    log = _copy(calm, tmp_path)
    log.with_suffix(".html").write_text("of another drive")
    with pytest.raises(ConfigError, match=r"calm\.html: expected no page of that name yet"):
        app.meta(["report", str(log)], result_action="return_value")
    assert log.with_suffix(".html").read_text() == "of another drive"
