"""Tables, JSON, report page and model card of an evaluation."""

import json
from dataclasses import replace

import numpy as np
import pytest
from made_models import input_gains, join_gains, saturations
from toy_predictors import WithError, made_test_set, made_trajectories, with_random_error

from offline.evaluation import lane_change, page
from offline.evaluation.comparison import compare_models
from offline.evaluation.model_card import model_facts, write_card
from offline.evaluation.series import Series, Slice
from offline.evaluation.tables import comparison_tables, headline, mse_table, ratio_table
from offline.model.export_checks import BoxStability, DrivenStability, ExportFigures
from rt_controller.contract.figures import write_figures
from rt_controller.contract.signals import VEHICLE, Schema, Signal
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.dynamics import Shape
from rt_controller.model.follow import Follow
from rt_controller.model.lift import Lift
from rt_controller.model.validity import Validity
from rt_controller.report.page import render_page
from rt_controller.report.table import Fact, format_number
from sim_bridge.scenario import load_scenario

MADE = made_trajectories(60)
CURVATURE = np.repeat([-4e-3, 0.0, 4e-3], 20)


def made_comparison(baselines, **models):
    """On three sets, with a series of two slices."""
    sets = [
        made_test_set(MADE, CURVATURE),
        made_test_set(MADE.take(slice(0, 40)), CURVATURE[:40] + 1e-3, "new-roads"),
        made_test_set(MADE.take(slice(20, 60)), CURVATURE[20:], "robustness"),
    ]
    rows = np.arange(60) < 20
    slices = (Slice("0 to 9", "library", rows), Slice("9 to 16", "library", ~rows))
    return compare_models(
        {"mdk-net": with_random_error(MADE), **models},
        baselines,
        sets,
        VEHICLE,
        classes={name: "recurrent" if name == "persistence" else "linear" for name in baselines},
        series=[Series("sideslip", "peak sideslip", "deg", "library", slices)],
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


@pytest.fixture(scope="module")
def figures(comparison):
    return comparison.figures


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


def test_every_number_of_the_tables_is_in_the_json(comparison, figures):
    written = numbers_in(figures)
    tables = comparison_tables(comparison)
    assert len(tables) == 2 + 2 * 2
    for table in tables:
        for _, *cells in table.rows:
            for cell in cells:
                text, detail = (cell, "") if isinstance(cell, str) else cell[:2]
                assert {text, *filter(None, detail.split("–"))} <= written, (table.title, cell)


def test_json_is_indexed_by_model_state_and_unit(figures):
    library = figures["sets"]["library"]
    assert (library["n_trajectories"], library["n_episodes"]) == (60, 12)
    model = library["models"]["linear/mdk-net"]
    assert set(model["mse"]["vx_kmh_squared"]) == {"value", "low", "high"}
    assert model["rms"]["vx_kmh"]["value"] ** 2 == pytest.approx(
        model["mse"]["vx_kmh_squared"]["value"]
    )
    assert set(model["mse_by_curvature_per_m"]) == {"-0.004", "0", "0.004"}
    ratio = library["baseline_mse_over_model_mse"]["mdk-net"]["lti"]
    assert {"vx", "geometric_mean", "geometric_mean_without_ds"} <= set(ratio)
    first = figures["series"]["sideslip"]["slices"][0]
    assert (first["label"], first["set"], first["n_trajectories"]) == ("0 to 9", "library", 20)
    assert first["best_baseline"] == {"linear": "lti-per-curvature"}
    steps = library["by_step"]["mdk-net"]["rms"]["yaw_rate_degps"]
    assert {len(steps[part]) for part in ("value", "low", "high")} == {80}
    assert set(library["absolute_error_quantiles"]["mdk-net"]) == {
        "after_0.5_s", "after_1_s", "after_2_s",
    }  # fmt: skip


def test_errors_of_a_diverging_model_are_null_in_json_and_named_below_the_table(tmp_path):
    error = np.zeros(MADE.x.shape)
    error[0, 3:] = np.inf
    broken = {"broken": WithError(MADE, error)}
    comparison = compare_models(broken, {}, [made_test_set(MADE)], VEHICLE)
    write_figures(tmp_path / "figures.json", comparison.figures)
    figures = json.loads((tmp_path / "figures.json").read_text())
    model = figures["sets"]["library"]["models"]["broken"]
    assert model["mse"]["vx_kmh_squared"]["value"] is None
    assert model["trajectories_without_finite_prediction"] == 1
    assert "broken on 1" in mse_table(comparison, comparison.sets[0]).footnotes[0]


def test_the_first_sentence_has_the_errors_at_the_end_of_the_horizon(comparison):
    by_step, text = comparison.library["by_step"], headline(comparison)
    for name in ("mdk-net", "linear/mdk-net", "lti-per-curvature"):
        end_m, end_kmh = (by_step[name]["rms"][key]["value"][-1] for key in ("ey_m", "vx_kmh"))
        errors = f"{format_number(end_m, 2)} m in lateral position and {format_number(end_kmh, 2)}"
        assert errors in text
    assert "60 trajectories" in text


def test_a_baseline_that_did_not_converge_is_named_below_tables_and_in_json():
    library = made_test_set(MADE)
    models = {"m": with_random_error(MADE)}, {"gru": with_random_error(MADE, 2.0)}
    comparison = compare_models(*models, [library], VEHICLE, not_converged=("gru",))
    for table in (mse_table(comparison, library), ratio_table(comparison, "m", library)):
        assert any("Not converged" in note and "gru" in note for note in table.footnotes)
    assert comparison.figures["not_converged"] == ["gru"]


@pytest.fixture(scope="module")
def shown():
    return made_comparison(
        {
            "lti": with_random_error(MADE, 2.0, 1),
            "lti-per-curvature <x>": with_random_error(MADE, 3.0, 2),
        }
    )


def made_page(shown, predicted):
    windows = made_trajectories(lane_change.WINDOWS)
    scenario = load_scenario("double_lane_change")
    driven = lane_change.LaneChange(scenario, windows, windows.x[..., 4].astype(float))
    bundles = [load_bundle(shipped_model("lti"))] * len(shown.models)
    states = {name: windows.x.astype(float) + 1.0 for name in predicted}
    return render_page(page.evaluation_page(shown, bundles, (driven, states)))


def test_page_shows_the_first_table_and_four_plots_without_a_script(shown):
    html = made_page(shown, shown.names)
    assert html.count("<svg") == 4
    assert "<script" not in html
    for _, *cells in mse_table(shown, shown.sets[0]).rows:
        assert all(f"{cell.text}<br><small>{cell.detail}</small>" in html for cell in cells)
    body = html[html.index("<h1") :]
    assert body.index(headline(shown)) < body.index("<svg") < body.index("<table")
    for text in ("80 km/h", "lti-per-curvature &lt;x&gt;"):
        assert text in html


def test_a_diverging_baseline_can_be_drawn():
    error = np.zeros(MADE.x.shape)
    error[0, 30:] = np.nan
    error[1, 30:] = 1e200
    shown = made_comparison({"broken": WithError(MADE, error)})
    assert made_page(shown, shown.models).count("<svg") == 4


def test_data_of_other_states_without_roads_have_a_page_without_a_lane_change(lti):
    schema = Schema((Signal("speed_mps", "m/s"), Signal("heat_k", "K")), (), (), 0.1)
    made = made_trajectories(20, steps=40, states=2)
    shown = compare_models(
        {"m": with_random_error(made)},
        {"n": with_random_error(made, 2.0)},
        [made_test_set(made)],
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
    comparison = compare_models(models, baselines, [made_test_set(made)], VEHICLE)
    card = write_card(lti, CHECKS, comparison, [Fact("preset", "tiny")])
    assert "| preset | tiny |" in card
    assert lti.sha256 in card
    assert "Under inputs: gains unsaturated: spectral radius 1.00070, growth over 80 s" in card
    assert "steps 6.25; gains saturated: spectral radius 0.99940, growth over 80 steps 5.5;" in card
    assert "gains at states: spectral radius 1.01230, growth over 80 steps 17.5 (at all" in card
    assert "as trained: 2.5e-07" in card
    assert "vx_mps 1.5, vy_mps 2.5, yaw_rate_radps 3.5" in card
    assert "epsi_rad 650" in card
    assert "The ranges of its training data are not known." in card
    three = np.array([3.0, 4.0, 5.0])
    validity = Validity(three, three, three, 0.01 * three, np.array([[0.5, 1.0], [0.0, 0.0]]))
    known = write_card(replace(lti, validity=validity), CHECKS, comparison, [])
    assert "| 14 | 4 | 229 | 0.04 |" in known
    assert "| friction | 0.5 to 1 |" in known
    assert "| grade | 0 % |" in known
    for model in comparison.library["models"].values():
        value, low, high = model["mse"]["ey_m_squared"].values()
        interval = f"{format_number(low, 3)}–{format_number(high, 3)}"
        assert f"{format_number(value)} ({interval})" in card


def test_card_says_what_the_lift_uses_and_how_the_inputs_act(lti):
    plain = dict(model_facts(lti))
    assert plain["input matrix"] == "constant"
    assert plain["motion without inputs"] == "linear in the lifted state"
    assert "curvature" not in plain["observables"]
    n = lti.n_observables
    richer = replace(
        lti,
        lift=Lift(True, 4, ("vx_mps", "steer_rad")),
        gains=input_gains(np.zeros((3, n, 3)), np.zeros((3, 3, n)), np.zeros((3, 3)), False),
    )
    found = dict(model_facts(richer))
    assert "rank 3, following the lifted state" in found["input matrix"]
    assert "curvature_per_m" in found["observables"]
    assert "the last 4 periods (100 ms) of vx_mps, steer_rad" in found["observables"]
    frozen = replace(richer, gains=richer.gains._replace(follows=Follow.START))
    assert "rank 3, frozen at the first" in dict(model_facts(frozen))["input matrix"]
    shape = np.full(9, Shape.TANH)
    drift = saturations(np.zeros((n, 3)), np.zeros((3, n)), np.zeros(3), np.array([4, 3, 4]), one=4)
    bent = replace(richer, gains=join_gains(richer.gains._replace(shape=shape), drift))
    facts = dict(model_facts(bent))
    assert facts["input matrix"].startswith("saturating, bilinear of rank 3")
    expected = "saturating with rank 2, and 1 products with curvature_per_m"
    assert facts["motion without inputs"] == expected
