"""The page: complete, and without a word to the network."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest
from toy_predictors import Off, judged_on, made_trajectories, scattered

from offline import lane_change
from offline.card import Fact
from offline.evaluation_sheets import mse_sheet, ratio_sheet
from offline.judgement import judge
from offline.report import plots
from offline.report.canvas import as_svg, pens
from offline.report.lane_change_plot import lane_change_plot
from offline.report.page import Contents, Scene, Subject, page
from offline.report_run import require_writable_page
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.schema import VEHICLE, Schema, Signal
from sim_bridge.scenario import load_scenario

MADE = made_trajectories(60)
CURVATURE = np.repeat([-4e-3, 0.0, 4e-3], 20)


def make_judgement(**rivals):
    sets = [
        judged_on(MADE, CURVATURE),
        judged_on(MADE, CURVATURE + 1e-3, "new-roads"),
        judged_on(MADE, CURVATURE, "robustness"),
    ]
    return judge({"mdk-net": scattered(MADE)}, rivals, sets, VEHICLE)


@pytest.fixture(scope="module")
def judgement():
    return make_judgement(
        **{"lti": scattered(MADE, 2.0, 1), "lti-per-curvature <x>": scattered(MADE, 3.0, 2)}
    )


def driven_by_hand():
    windows = made_trajectories(lane_change.WINDOWS)
    scenario = load_scenario("double_lane_change")
    return lane_change.LaneChange(scenario, windows, windows.x[..., 4].astype(float))


def make_page(judgement):
    driven = driven_by_hand()
    foreseen = {name: driven.windows.x.astype(float) + 1.0 for name in judgement.names}
    drawn = lane_change_plot(
        driven, foreseen, pens(judgement.judged, judgement.rivals), judgement.judged
    )
    return page(
        Contents(
            judgement,
            [Subject("mdk-net", [Fact("model, SHA-256", "abcdef")])],
            [Subject("lti", [Fact("spectral radius", "1.00123")])],
            [Fact("revision", "b7c81e03e3c7")],
            Scene(driven.words, drawn),
        )
    )


@pytest.fixture(scope="module")
def html(judgement):
    return make_page(judgement)


class Tags(HTMLParser):
    """Collects what a browser would fetch, and whether all elements are closed."""

    VOID = ("meta", "br", "path", "use", "image", "rect", "line", "circle", "clippath")

    def __init__(self):
        super().__init__()
        self.fetched, self.open = [], []

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if name in ("src", "href", "xlink:href", "srcset", "data") and value[:1] != "#":
                self.fetched.append(value)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in self.VOID:
            assert self.open.pop() == tag


def test_the_page_fetches_nothing_and_runs_nothing(html):
    tags = Tags()
    tags.feed(html)
    assert [address for address in tags.fetched if not address.startswith("data:")] == []
    assert tags.open == []
    for word in ("<script", "@import", "url(http", "<link", "<iframe"):
        assert word not in html


def test_the_page_shows_the_tables_the_plots_and_what_was_judged(judgement, html):
    assert html.count("<svg") == 5
    for sheet in (
        mse_sheet(judgement, judgement.sets[0]),
        ratio_sheet(judgement, "mdk-net", judgement.sets[0]),
    ):
        for _, cells in sheet.rows:
            for cell in cells:
                assert f"<td>{cell.figure}<br><small>{cell.interval}</small></td>" in html
    for word in (
        "abcdef",
        "1.00123",
        "b7c81e03e3c7",
        "0" * 64,
        "new-roads",
        "robustness",
        "80 km/h",
    ):
        assert word in html


def test_names_are_escaped(html):
    assert "lti-per-curvature &lt;x&gt;" in html
    assert "curvature <x>" not in html


def test_the_same_figures_make_the_same_drawing(judgement):
    once, again = (as_svg(plots.ratio_bars(judgement, "mdk-net")) for _ in range(2))
    assert once == again


def test_a_rival_that_blew_up_is_drawn_as_far_as_it_goes():
    error = np.zeros(MADE.x.shape)
    error[0, 30:] = np.nan
    error[1, 30:] = 1e200
    judgement = make_judgement(broken=Off(MADE, error))
    for drawn in (
        plots.rms_over_time(judgement),
        plots.ratio_bars(judgement, "mdk-net"),
        plots.road_heat(judgement, "mdk-net"),
        plots.quantiles_over_time(judgement, "mdk-net"),
    ):
        assert as_svg(drawn).startswith("<svg")


def test_data_without_roads_and_of_other_states_have_a_page_too():
    schema = Schema((Signal("speed_mps", "m/s"), Signal("heat_k", "K")), (), (), 0.1)
    made = made_trajectories(20, steps=40, states=2)
    judgement = judge(
        {"m": scattered(made)}, {"n": scattered(made, 2.0)}, [judged_on(made)], schema
    )
    html = page(Contents(judgement, [], [], [], None))
    assert "Double lane change" not in html
    assert "heat" in html
    assert "curvature" not in re.sub(r"<style>.*?</style>", "", html)


@pytest.mark.parametrize("output", [".", "no/such/folder/report.html"])
def test_a_page_that_cannot_be_written_is_refused_before_the_work(output, tmp_path):
    with pytest.raises(ConfigError, match="--output"):
        require_writable_page(tmp_path / output)
    require_writable_page(tmp_path / "report.html")
