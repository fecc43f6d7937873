"""What is printed of an evaluation, and the same for programs."""

import json
import re

import numpy as np
import pytest
from toy_predictors import Off, judged_on, made_trajectories, scattered

from offline.evaluation_figures import judgement_figures, pooled_figures
from offline.evaluation_run import print_judgement
from offline.evaluation_sheets import (
    growth_sheet,
    mse_sheet,
    quantile_sheet,
    ratio_sheet,
    rms_sheet,
    road_sheets,
)
from offline.judgement import judge
from offline.sheet import Cell, Sheet, in_digits, print_sheet, sheet_as_html, sheet_as_markdown
from rt_controller.contract.figures import write_figures
from rt_controller.contract.schema import VEHICLE

MADE = made_trajectories(60)
CURVATURE = np.repeat([-4e-3, 0.0, 4e-3], 20)


@pytest.fixture(scope="module")
def judgement():
    """Two models and three rivals on three sets."""
    sets = [
        judged_on(MADE, CURVATURE),
        judged_on(MADE.take(slice(0, 40)), CURVATURE[:40] + 1e-3, "new-roads"),
        judged_on(MADE.take(slice(20, 60)), CURVATURE[20:], "robustness"),
    ]
    models = {"mdk-net": scattered(MADE), "linear/mdk-net": scattered(MADE, 1.3, seed=1)}
    rivals = {
        "lti": scattered(MADE, 2.0, seed=2),
        "lti-per-curvature": scattered(MADE, 1.7, seed=3),
        "persistence": scattered(MADE, 1e-4, seed=4),
    }
    return judge(models, rivals, sets, VEHICLE)


@pytest.fixture(scope="module")
def figures(judgement):
    return judgement_figures(judgement)


@pytest.fixture(scope="module")
def sheets(judgement):
    return all_sheets(judgement)


def all_sheets(judgement):
    library, *others = judgement.sets
    return [
        mse_sheet(judgement, library),
        rms_sheet(judgement, library),
        *road_sheets(judgement, library),
        *(quantile_sheet(judgement, model) for model in judgement.judged),
        *(ratio_sheet(judgement, model, library) for model in judgement.judged),
        *(growth_sheet(judgement, test) for test in others),
    ]


def numbers_of(figures):
    """Every number of a JSON tree, as tables show numbers."""
    if isinstance(figures, dict | list):
        items = figures.values() if isinstance(figures, dict) else figures
        return set().union(*map(numbers_of, items))
    if isinstance(figures, float):
        return {in_digits(figures), in_digits(figures, 3)}
    return set()


def test_every_figure_that_is_printed_is_in_the_json(figures, sheets):
    written = numbers_of(figures)
    for sheet in sheets:
        for name, cells in sheet.rows:
            for cell in cells:
                shown = [cell.figure, *filter(None, cell.interval.split("–"))]
                assert set(shown) <= written, (sheet.title, name, cell)


def test_everything_is_printed_and_nothing_cut_on_a_narrow_terminal(
    judgement, sheets, capsys, monkeypatch
):
    monkeypatch.setenv("COLUMNS", "40")
    print_judgement(judgement)
    printed = capsys.readouterr().out
    assert "…" not in printed
    for sheet in sheets:
        for _, cells in sheet.rows:
            for cell in cells:
                assert cell.figure in printed
                assert cell.interval in printed


def test_figures_of_the_json_are_found_by_model_state_and_unit(figures):
    library = figures["sets"]["library"]
    assert library["n_trajectories"] == 60
    assert library["n_episodes"] == 12
    model = library["models"]["linear/mdk-net"]
    assert set(model["mse"]["vx_kmh_squared"]) == {"value", "low", "high"}
    assert model["rms"]["vx_kmh"]["value"] ** 2 == pytest.approx(
        model["mse"]["vx_kmh_squared"]["value"]
    )
    assert set(model["mse_by_curvature_per_m"]) == {"-0.004", "0", "0.004"}
    ratio = library["rival_mse_over_model_mse"]["mdk-net"]["lti"]
    assert ratio["vx"]["value"] == pytest.approx(
        library["models"]["lti"]["mse"]["vx_kmh_squared"]["value"]
        / library["models"]["mdk-net"]["mse"]["vx_kmh_squared"]["value"]
    )
    assert "geometric_mean" in ratio
    steps = library["by_step"]["mdk-net"]["rms"]["yaw_rate_degps"]
    assert {len(steps[part]) for part in ("value", "low", "high")} == {80}
    assert set(library["absolute_error_quantiles"]["mdk-net"]) == {
        "after_0.5_s", "after_1_s", "after_2_s",
    }  # fmt: skip


def test_new_roads_are_held_against_their_goal(judgement, figures):
    figures = figures["sets"]["new-roads"]
    assert figures["goal"] == 1.5
    worst = max(
        figures["mse_over_library_mse"]["mdk-net"][state]["value"]
        for state in ("vx", "vy", "yaw_rate", "ds", "ey", "epsi")
    )
    assert figures["is_within_goal"]["mdk-net"] is (worst <= 1.5)
    note = growth_sheet(judgement, judgement.find_set("new-roads")).note
    assert in_digits(worst, 3) in note
    assert note.count("reached") == 2


def test_figures_of_a_model_that_blew_up_are_null_in_json(tmp_path):
    error = np.zeros(MADE.x.shape)
    error[0, 3:] = np.inf
    judgement = judge({"broken": Off(MADE, error)}, {}, [judged_on(MADE)], VEHICLE)
    write_figures(tmp_path / "figures.json", judgement_figures(judgement))
    figures = json.loads((tmp_path / "figures.json").read_text())
    model = figures["sets"]["library"]["models"]["broken"]
    assert model["mse"]["vx_kmh_squared"]["value"] is None
    assert model["trajectories_without_finite_prediction"] == 1
    assert "broken on 1" in mse_sheet(judgement, judgement.sets[0]).note


def test_pooled_figures_are_those_of_the_library(judgement, figures):
    pooled = pooled_figures(judgement)
    library = figures["sets"]["library"]
    assert pooled["n_trajectories"] == 60
    for name in judgement.names:
        assert pooled["models"][name]["mse"] == library["models"][name]["mse"]


SHEET = Sheet("a < b", (("model", ""), ("v", "m/s")), (("x & y", (Cell("1.5", "1.2–1.9"),)),), "n")


def test_a_sheet_is_the_same_table_on_a_terminal_in_markdown_and_in_html(capsys):
    print_sheet(SHEET)
    printed = capsys.readouterr().out
    for word in ("a < b", "m/s", "x & y", "1.5", "1.2–1.9", "n"):
        assert word in printed
    assert sheet_as_markdown(SHEET).splitlines() == [
        "| model | v, m/s |",
        "|---|---|",
        "| x & y | 1.5 (1.2–1.9) |",
    ]
    html = sheet_as_html(SHEET)
    assert re.search(r"<th>x &amp; y</th><td>1.5<br><small>1.2–1.9</small></td>", html)


def test_a_figure_that_is_no_number_is_a_dash_and_has_no_interval():
    judgement = judge({"alone": scattered(MADE)}, {}, [judged_on(MADE.take(slice(0, 5)))], VEHICLE)
    ((_, cells),) = mse_sheet(judgement, judgement.sets[0]).rows
    assert all(cell.interval == "" for cell in cells)
    assert in_digits(float("nan")) == "–"
