"""`compare` and `rt-controller compare`: several controllers in the same scenarios."""

import json
from dataclasses import replace

import pytest

from rt_controller import ControlInput, Observation, cli, compare, simulate
from rt_controller.contract.errors import ConfigError
from rt_controller.settings import CarSettings
from sim_bridge.campaign import Backend
from sim_bridge.scenario import load_scenario

ONE = Backend(jobs=1)
SHORT = tuple(
    replace(load_scenario(name), duration_s=2.0, name=name) for name in ("straight", "sine_60")
)


class Failing:
    """A law that ends after a second."""

    def __init__(self) -> None:
        self.calls = 0

    def control(self, now: Observation) -> ControlInput:
        self.calls += 1
        if self.calls > 40:
            raise ZeroDivisionError("no lookahead")
        return now.previous


LAW = """
class Mine:
    def control(self, now):
        return (0.15, 0.0, GAIN * now.state.ey_m)
"""


@pytest.fixture
def law_file(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(LAW.replace("GAIN", "-0.4"))
    return file


@pytest.fixture(scope="module")
def comparison():
    return compare(["lti", "stanley", Failing()], SHORT, backend=ONE)


def test_the_figures_are_those_of_the_car_in_the_drive_that_simulate_makes(comparison):
    names = "ey_rms_m", "ey_peak_m", "speed_rms_mps"
    drive = simulate(replace(SHORT[1], metrics=names), controller="stanley")
    true = {figure.name: figure.value for figure in drive.car_figures}
    (row,) = comparison.of("stanley", "sine_60")
    assert row.ey_peak_m > row.ey_rms_m > 0.0
    assert {name: getattr(row, name) for name in names} == pytest.approx(true)
    assert row.step_p99_us > row.step_p50_us > 0.0
    assert comparison.drives["stanley", "sine_60", 0].values.shape == drive.values.shape
    assert row.lateral_jerk_rms_mps3 > comparison.of("stanley", "straight")[0].lateral_jerk_rms_mps3


def test_a_law_that_fails_ends_its_own_drives_only(comparison):
    assert comparison.controllers == ("lti", "stanley", "Failing")
    (failed,) = comparison.of("Failing", "straight")
    assert "ZeroDivisionError: no lookahead" in failed.failure
    assert failed.ey_rms_m != failed.ey_rms_m
    assert all(not row.failure for row in comparison.rows if row.controller != "Failing")
    assert set(comparison.first_drives("straight")) == {"lti", "stanley"}


def test_a_comparison_shows_itself_in_a_notebook(comparison):
    pytest.importorskip("matplotlib")
    shown = comparison._repr_html_()
    assert shown.count("<tr>") == 1 + 2 * (1 + 3)  # heads, then each scenario with three rows
    assert "<svg" in shown
    assert "ZeroDivisionError: no lookahead" in shown


def test_seeds_are_other_noise_of_the_sensors():
    rows = compare(["stanley"], SHORT[:1], seeds=2, backend=ONE).rows
    assert [row.seed for row in rows] == [1, 2]
    assert 0.0 < rows[0].ey_rms_m != rows[1].ey_rms_m


def test_finished_drives_are_kept_until_their_controller_or_their_conditions_change(
    law_file, tmp_path
):
    results, driven = tmp_path / "results.jsonl", []

    def run(**options):
        kept = results.read_text().count("\n") if results.exists() else 0
        rows = compare(
            ["lti", f"{law_file}:Mine"], SHORT[:1], results=results, backend=ONE, **options
        ).rows
        driven.append(results.read_text().count("\n") - kept)
        return rows

    assert run()[1:] == run()[1:]
    law_file.write_text(LAW.replace("GAIN", "-0.2"))
    run()
    run(car=CarSettings(friction=0.5))
    assert driven == [2, 0, 1, 2]


@pytest.mark.parametrize(
    ("controllers", "scenarios", "options", "words"),
    [
        ([], SHORT, {}, "controllers: expected at least one, such as mdk-net"),
        (["lti", "lti"], SHORT, {}, "expected different ones, found lti twice"),
        (["stanly"], SHORT, {}, "did you mean stanley"),
        (["lti"], [], {}, "scenarios: expected at least one"),
        (["lti"], ["slalom", "slalom"], {}, "found slalom twice"),
        (["lti"], ["slallom"], {}, "slallom"),
        ([Failing()], SHORT, {"results": "x.jsonl"}, "expected controllers by name"),
    ],
)
def test_what_cannot_be_compared_is_refused_before_the_first_drive(
    controllers, scenarios, options, words
):
    with pytest.raises(ConfigError, match=words):
        compare(controllers, scenarios, **options, on_progress=pytest.fail)


def test_the_command_prints_the_best_of_each_column_and_writes_page_picture_and_figures(
    tmp_path, law_file, capsys, monkeypatch
):
    pytest.importorskip("matplotlib")
    monkeypatch.setenv("COLUMNS", "80")
    files = {name: tmp_path / f"x.{name}" for name in ("html", "svg", "json")}
    scenario = tmp_path / "short.toml"
    scenario.write_text(
        'format = 2\nname = "short"\nduration_s = 2.0\n[reference]\nspeed_kmh = 60.0\n'
        'ey_m = {kind = "sine", amplitude_m = 0.3, frequency_hz = 0.5}\n'
    )
    command = ["compare", "mdk-net", "lti", f"{law_file}:Mine", "--scenario", str(scenario)]
    command += ["--html", str(files["html"]), "--plot", str(files["svg"]), "--jobs", "1"]
    with pytest.raises(SystemExit) as ended:
        cli.run_command(cli.app, [*command, "--json", str(files["json"])])
    assert ended.value.code == 0
    found = capsys.readouterr()
    assert found.out.startswith("mdk-net has the smallest lateral error in 1 of 1 scenarios.")
    assert max(map(len, found.out.splitlines()[1:])) <= 80
    assert "3: " in found.err
    rows = json.loads(files["json"].read_text())["drives"]
    assert [row["controller"] for row in rows] == ["mdk-net", "lti", "Mine"]
    assert rows[0]["ey_rms_m"] < min(rows[1]["ey_rms_m"], rows[2]["ey_rms_m"])
    page = files["html"].read_text()
    assert page.count("<svg") == 1
    assert "Mine" in page
    assert files["svg"].read_text().count("<svg") == 1
