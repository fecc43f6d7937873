"""Tables, JSON, report page and model card of an evaluation."""

import json
from dataclasses import replace

import numpy as np
import pytest
from made_models import input_gains, join_gains, saturations
from rich.console import Console
from toy_predictors import WithError, made_test_set, made_trajectories, with_random_error

from offline.evaluation import lane_change, page
from offline.evaluation.comparison import compare_models
from offline.evaluation.model_card import model_facts, write_card
from offline.evaluation.parts import Part, whole_part
from offline.evaluation.tables import (
    all_tables,
    headline,
    mse_table,
    ratio_table,
    screen_tables,
)
from offline.model.export_checks import BoxStability, DrivenStability, ExportFigures
from rt_controller.contract.figures import write_figures
from rt_controller.contract.signals import VEHICLE, Schema, Signal
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.dynamics import Shape
from rt_controller.model.lift import Lift
from rt_controller.model.validity import Validity
from rt_controller.report.page import render_page
from rt_controller.report.table import Fact, format_number, print_table
from sim_bridge.scenario import load_scenario

MADE = made_trajectories(60)


def made_comparison(baselines, **models):
    """On two sets, and on a slice of the first."""
    library = whole_part(made_test_set(MADE))
    robustness = whole_part(made_test_set(MADE.take(slice(20, 60)), "robustness"))
    return compare_models(
        {"mdk-net": with_random_error(MADE), **models},
        baselines,
        [library, robustness, Part("slow", "", library.test, np.arange(60) < 20)],
        VEHICLE,
        linear=[name for name in baselines if name != "persistence"],
    )


@pytest.fixture(scope="module")
def comparison():
    """Two models and three baselines."""
    baselines = {
        "lti": with_random_error(MADE, 2.0, seed=2),
        "lti-per-curvature": with_random_error(MADE, 1.7, seed=3),
        "persistence": with_random_error(MADE, 1e-4, seed=4),
    }
    return made_comparison(baselines, **{"linear/mdk-net": with_random_error(MADE, 1.3, seed=1)})


def numbers_in(figures):
    """Every number of a JSON tree, formatted as in tables."""
    if isinstance(figures, dict | list):
        items = figures.values() if isinstance(figures, dict) else figures
        return set().union(*map(numbers_in, items))
    if isinstance(figures, float):
        return {format_number(figures), format_number(figures, 3)}
    if isinstance(figures, int | str):
        return {str(figures)}
    return set()


def test_every_number_of_the_tables_is_in_the_json(comparison):
    written = numbers_in(comparison.figures()) | {"–"}
    for table in [*all_tables(comparison), *screen_tables(comparison)]:
        for _, *cells in table.rows:
            for cell in cells:
                text, detail = (cell, "") if isinstance(cell, str) else cell[:2]
                value, _, interval = text.partition(" (")
                ends = [*detail.split("–"), *interval.removesuffix(")").split("–")]
                texts = {value, *filter(None, ends)}
                assert texts <= written, (table.title, cell)


def test_one_screen_has_the_errors_and_all_test_sets(comparison):
    errors, parts = screen_tables(comparison)
    assert [row[0] for row in errors.rows] == [*comparison.names]
    assert [row[0] for row in parts.rows] == ["library", "robustness"]
    assert "slow" in [row[0] for row in all_tables(comparison)[-1].rows]


def test_both_tables_of_one_screen_fit_80_columns():
    models = {"mdk-net": 100.0, "mdk-net-paper": 400.0}, {"lti-scheduled-delays": 900.0}
    models, linear = (
        {k: with_random_error(MADE, f, 1) for k, f in each.items()} for each in models
    )
    parts = [whole_part(made_test_set(MADE)), whole_part(made_test_set(MADE, "friction-0.5"))]
    console = Console(width=80)
    for table in screen_tables(compare_models(models, linear, parts, VEHICLE, linear=linear)):
        with console.capture() as shown:
            print_table(table, console)
        names = [line for line in shown.get().splitlines() if table.rows[0][0] in line.split()[:1]]
        assert len(names) == 1, "the table is printed in several parts"


def test_errors_of_a_diverging_model_are_null_in_json_and_named_below_the_table(tmp_path):
    error = np.zeros(MADE.x.shape)
    error[0, 3:] = np.inf
    broken = {"broken": WithError(MADE, error)}
    comparison = compare_models(broken, {}, [whole_part(made_test_set(MADE))], VEHICLE)
    write_figures(tmp_path / "figures.json", comparison.figures())
    row = json.loads((tmp_path / "figures.json").read_text())["rows"][0]
    assert (row["state"], row["unit"], row["trajectories"]) == ("vx", "km/h", 60)
    assert row["mse"] is None
    assert row["diverged"] == 1
    assert "broken on 1" in mse_table(comparison).footnotes[1]


def test_a_baseline_that_did_not_converge_is_named_below_tables_and_in_json():
    library = whole_part(made_test_set(MADE))
    models = {"m": with_random_error(MADE)}, {"gru": with_random_error(MADE, 2.0)}
    comparison = compare_models(*models, [library], VEHICLE, not_converged=("gru",))
    for table in (mse_table(comparison), ratio_table(comparison)):
        assert any("Not converged" in note and "gru" in note for note in table.footnotes)
    assert comparison.figures()["not_converged"] == ["gru"]


@pytest.fixture(scope="module")
def shown():
    baselines = {"lti": with_random_error(MADE, 2.0, 1)}
    return made_comparison(baselines | {"lti-per-curvature": with_random_error(MADE, 3.0, 2)})


def made_page(shown, predicted):
    windows = made_trajectories(lane_change.WINDOWS)
    scenario = load_scenario("double_lane_change")
    driven = lane_change.LaneChange(scenario, windows, windows.x[..., 4].astype(float))
    bundles = [load_bundle(shipped_model("lti"))] * len(shown.models)
    states = {name: windows.x.astype(float) + 1.0 for name in predicted}
    return render_page(page.evaluation_page(shown, bundles, (driven, states)))


def test_page_shows_the_first_table(shown):
    html = made_page(shown, shown.names)
    for _, *cells in mse_table(shown).rows:
        assert all(f"{cell.text}<br><small>{cell.detail}</small>" in html for cell in cells)
    assert html.index(headline(shown)) < html.index("<table")


def test_a_diverging_baseline_can_be_drawn():
    error = np.zeros(MADE.x.shape)
    error[0, 30:] = np.nan
    error[1, 30:] = 1e200
    shown = made_comparison({"broken": WithError(MADE, error)})
    assert "Double lane change" in made_page(shown, shown.models)


def test_data_of_other_states_without_roads_have_a_page_without_a_lane_change(lti):
    schema = Schema((Signal("speed_mps", "m/s"), Signal("heat_k", "K")), (), (), 0.1)
    made = made_trajectories(20, steps=40, states=2)
    shown = compare_models(
        {"m": with_random_error(made)},
        {"n": with_random_error(made, 2.0)},
        [whole_part(made_test_set(made))],
        schema,
    )
    html = render_page(page.evaluation_page(shown, [lti], None))
    assert "Double lane change" not in html
    assert "heat" in html


CHECKS = ExportFigures(
    parity=2.5e-7,
    stability=BoxStability(
        unsaturated=DrivenStability(1.0007, 6.25),
        saturated=DrivenStability(0.9994, 5.5),
        at_states=DrivenStability(1.0123, 17.5),
    ),
    persistence_over_model=np.array([1.5, 2.5, 3.5, 4.5, 5.5, 650.0]),
)


@pytest.fixture(scope="module")
def lti():
    return load_bundle(shipped_model("lti"))


def test_card_has_facts_hashes_and_every_error_with_its_interval(lti):
    made = made_trajectories(60)
    models = {"lti": with_random_error(made)}
    baselines = {"persistence": with_random_error(made, 2.0)}
    comparison = compare_models(models, baselines, [whole_part(made_test_set(made))], VEHICLE)
    card = write_card(lti, CHECKS, comparison, [Fact("preset", "tiny")])
    for text in ("| preset | tiny |", lti.sha256, "1.00070", "6.25", "0.99940", "5.5", "1.01230",
                 "17.5", "2.5e-07", "vx_mps 1.5", "epsi_rad 650", "are not known"):  # fmt: skip
        assert text in card
    three = np.array([3.0, 4.0, 5.0])
    validity = Validity(three, three, three, 0.01 * three, np.array([[0.5, 1.0], [0.0, 0.0]]))
    known = write_card(replace(lti, validity=validity), CHECKS, comparison, [])
    for text in ("| 14 | 4 | 229 | 0.04 |", "| friction | 0.5 to 1 |", "| grade | 0 % |"):
        assert text in known
    for rows in comparison.library.values():
        interval = f"{format_number(rows[4].mse_low, 3)}–{format_number(rows[4].mse_high, 3)}"
        assert f"{format_number(rows[4].mse)} ({interval})" in card


def test_card_says_what_the_lift_uses_and_how_the_inputs_act(lti):
    plain = dict(model_facts(lti))
    assert plain["input matrix"] == "constant"
    assert plain["motion without inputs"] == "linear in the lifted state"
    n = lti.n_observables
    bilinear = input_gains(np.zeros((3, n, 3)), np.zeros((3, 3, n)), np.zeros((3, 3)), False)
    richer = replace(lti, lift=Lift(True, 4, ("vx_mps", "steer_rad")), gains=bilinear)
    found = dict(model_facts(richer))
    assert "rank 3, following" in found["input matrix"]
    assert "curvature_per_m" in found["observables"]
    assert "the last 4 periods (100 ms) of vx_mps, steer_rad" in found["observables"]
    shape = np.full(9, Shape.TANH)
    drift = saturations(np.zeros((n, 3)), np.zeros((3, n)), np.zeros(3), np.array([4, 3, 4]), one=4)
    bent = replace(richer, gains=join_gains(bilinear._replace(shape=shape), drift))
    facts = dict(model_facts(bent))
    assert facts["input matrix"].startswith("saturating, bilinear of rank 3")
    assert "saturating with rank 2, and 1 products" in facts["motion without inputs"]
