"""The report page of an evaluation."""

import re

import numpy as np
import pytest
from toy_predictors import WithError, made_test_set, made_trajectories, with_random_error

from offline.evaluation import lane_change, plots
from offline.evaluation.comparison import compare_models
from offline.evaluation.report import evaluation_page, lane_change_section
from offline.evaluation.series import Series, Slice
from offline.evaluation.tables import conditions_table, headline, mse_table, ratio_table
from rt_controller.contract.signals import VEHICLE, Schema, Signal
from rt_controller.report.canvas import to_svg
from rt_controller.report.page import render_page
from rt_controller.report.table import Fact, facts_table
from sim_bridge.scenario import load_scenario

MADE = made_trajectories(60)
CURVATURE = np.repeat([-4e-3, 0.0, 4e-3], 20)


def made_comparison(**baselines):
    sets = [
        made_test_set(MADE, CURVATURE),
        made_test_set(MADE, CURVATURE + 1e-3, "new-roads"),
        made_test_set(MADE, CURVATURE, "robustness"),
    ]
    rows = np.arange(60) < 20
    slices = (Slice("0 to 9", "library", rows), Slice("9 to 16", "library", ~rows))
    return compare_models(
        {"mdk-net": with_random_error(MADE)},
        baselines,
        sets,
        VEHICLE,
        classes=dict.fromkeys(baselines, "linear"),
        series=[Series("sideslip", "peak sideslip", "deg", "library", slices)],
    )


@pytest.fixture(scope="module")
def comparison():
    return made_comparison(
        **{
            "lti": with_random_error(MADE, 2.0, 1),
            "lti-per-curvature <x>": with_random_error(MADE, 3.0, 2),
        }
    )


@pytest.fixture(scope="module")
def html(comparison):
    windows = made_trajectories(lane_change.WINDOWS)
    scenario = load_scenario("double_lane_change")
    driven = lane_change.LaneChange(scenario, windows, windows.x[..., 4].astype(float))
    predicted = {name: windows.x.astype(float) + 1.0 for name in comparison.names}
    page = evaluation_page(
        comparison,
        [facts_table([Fact("model, SHA-256", "abcdef"), Fact("revision", "b7c81e03e3c7")])],
        lane_change_section(driven, predicted, comparison),
    )
    return render_page(page)


def test_page_shows_tables_plots_models_and_sources_without_a_script(comparison, html):
    assert html.count("<svg") == 6
    assert "<script" not in html
    library = comparison.sets[0]
    for table in (mse_table(comparison, library), ratio_table(comparison, "mdk-net", library)):
        for _, *cells in table.rows:
            for cell, column in zip(cells, table.columns[1:], strict=True):
                head = f"{column.title}, {column.unit}" if column.unit else column.title
                shown = f"{cell.text}<br><small>{cell.detail}</small>"
                assert f'<td data-label="{head}">{shown}</td>' in html
    assert conditions_table(comparison, "mdk-net").title in html
    body = html[html.index("<h1") :]
    assert body.index(headline(comparison)) < body.index("<svg") < body.index("<table")
    assert "the mean squared error of lti, the best linear baseline, is" in html
    for text in ("abcdef", "b7c81e03e3c7", "0" * 64, "new-roads", "robustness",
                 "80 km/h", "lti-per-curvature &lt;x&gt;"):  # fmt: skip
        assert text in html


def test_the_page_names_only_baselines_that_are_part_of_the_comparison():
    comparison = made_comparison(lti=with_random_error(MADE, 2.0, 1))
    windows = made_trajectories(lane_change.WINDOWS)
    scenario = load_scenario("double_lane_change")
    driven = lane_change.LaneChange(scenario, windows, windows.x[..., 4].astype(float))
    predicted = {"mdk-net": windows.x.astype(float)}
    section = lane_change_section(driven, predicted, comparison)
    html = render_page(evaluation_page(comparison, [], section))
    for absent in ("fair lti", "lti-per-curvature", "one for each road", "paper's network"):
        assert absent not in html
    assert "Baselines shown: none." in html


def test_the_same_comparison_gives_the_same_drawing(comparison):
    once, again = (to_svg(plots.ratio_bars(comparison, "mdk-net")) for _ in range(2))
    assert once == again


def test_a_diverging_baseline_can_be_drawn():
    error = np.zeros(MADE.x.shape)
    error[0, 30:] = np.nan
    error[1, 30:] = 1e200
    comparison = made_comparison(broken=WithError(MADE, error))
    for figure in (
        plots.rms_over_time(comparison),
        plots.ratio_bars(comparison, "mdk-net"),
        plots.errors_by_condition(comparison),
        plots.road_heat_map(comparison, "mdk-net"),
        plots.quantiles_over_time(comparison, "mdk-net"),
    ):
        assert to_svg(figure).startswith("<svg")


def test_data_of_other_states_without_roads_have_a_page_without_the_sections_on_roads():
    schema = Schema((Signal("speed_mps", "m/s"), Signal("heat_k", "K")), (), (), 0.1)
    made = made_trajectories(20, steps=40, states=2)
    comparison = compare_models(
        {"m": with_random_error(made)},
        {"n": with_random_error(made, 2.0)},
        [made_test_set(made)],
        schema,
    )
    html = render_page(evaluation_page(comparison, [], None))
    assert "Double lane change" not in html
    assert "heat" in html
    assert "curvature" not in re.sub(r"<style>.*?</style>", "", html)
