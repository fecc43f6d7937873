"""Printed tables of an evaluation, and the same numbers in JSON."""

import json

import numpy as np
import pytest
from toy_predictors import WithError, made_test_set, made_trajectories, with_random_error

from offline.evaluation.comparison import compare_models, library_figures
from offline.evaluation.series import Series, Slice
from offline.evaluation.tables import (
    comparison_tables,
    conditions_table,
    headline,
    mse_table,
    ratio_table,
)
from rt_controller.contract.figures import write_figures
from rt_controller.contract.signals import VEHICLE
from rt_controller.report.table import format_number

MADE = made_trajectories(60)
CURVATURE = np.repeat([-4e-3, 0.0, 4e-3], 20)


@pytest.fixture(scope="module")
def comparison():
    """Two models and three baselines on three sets, with a series."""
    sets = [
        made_test_set(MADE, CURVATURE),
        made_test_set(MADE.take(slice(0, 40)), CURVATURE[:40] + 1e-3, "new-roads"),
        made_test_set(MADE.take(slice(20, 60)), CURVATURE[20:], "robustness"),
    ]
    models = {
        "mdk-net": with_random_error(MADE),
        "linear/mdk-net": with_random_error(MADE, 1.3, seed=1),
    }
    baselines = {
        "lti": with_random_error(MADE, 2.0, seed=2),
        "lti-per-curvature": with_random_error(MADE, 1.7, seed=3),
        "persistence": with_random_error(MADE, 1e-4, seed=4),
    }
    rows = np.arange(60) < 20
    slices = (Slice("0 to 9", "library", rows), Slice("9 to 16", "library", ~rows))
    return compare_models(
        models,
        baselines,
        sets,
        VEHICLE,
        classes={"lti": "linear", "lti-per-curvature": "linear", "persistence": "recurrent"},
        series=[Series("sideslip", "peak sideslip", "deg", "library", slices)],
    )


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
    assert ratio["vx"]["value"] == pytest.approx(
        library["models"]["lti"]["mse"]["vx_kmh_squared"]["value"]
        / library["models"]["mdk-net"]["mse"]["vx_kmh_squared"]["value"]
    )
    without_ds = [ratio[name]["value"] for name in ("vx", "vy", "yaw_rate", "ey", "epsi")]
    assert ratio["geometric_mean"]["value"] == pytest.approx(
        np.prod([*without_ds, ratio["ds"]["value"]]) ** (1 / 6)
    )
    assert ratio["geometric_mean_without_ds"]["value"] == pytest.approx(
        np.prod(without_ds) ** (1 / 5)
    )
    first = figures["series"]["sideslip"]["slices"][0]
    assert (first["label"], first["set"], first["n_trajectories"]) == ("0 to 9", "library", 20)
    assert first["best_baseline"] == {"linear": "lti-per-curvature"}
    medians = library["baseline_mse_quantile_over_model_mse_quantile"]["mdk-net"]["p50"]
    quantiles = "mse_quantiles_over_trajectories"
    assert medians["lti"]["vx"]["value"] == pytest.approx(
        library["models"]["lti"][quantiles]["p50"]["vx_kmh_squared"]["value"]
        / library["models"]["mdk-net"][quantiles]["p50"]["vx_kmh_squared"]["value"]
    )
    steps = library["by_step"]["mdk-net"]["rms"]["yaw_rate_degps"]
    assert {len(steps[part]) for part in ("value", "low", "high")} == {80}
    assert set(library["absolute_error_quantiles"]["mdk-net"]) == {
        "after_0.5_s", "after_1_s", "after_2_s",
    }  # fmt: skip


def test_errors_on_new_roads_are_compared_with_the_goal(figures):
    new_roads = figures["sets"]["new-roads"]
    assert new_roads["goal"] == 1.5
    ratios = new_roads["mse_over_library_mse"]["mdk-net"]
    worst = max(ratio["value"] for state, ratio in ratios.items() if state != "geometric_mean")
    assert new_roads["is_within_goal"]["mdk-net"] is (worst <= 1.5)


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


def test_figures_of_the_library_are_part_of_all_figures(comparison, figures):
    found = library_figures(comparison)
    assert found["n_trajectories"] == 60
    for name in comparison.names:
        model = figures["sets"]["library"]["models"][name]
        assert found["models"][name]["mse"] == model["mse"]


def test_errors_of_a_single_episode_have_no_interval():
    one_episode = made_test_set(MADE.take(slice(0, 5)))
    comparison = compare_models({"m": with_random_error(MADE)}, {}, [one_episode], VEHICLE)
    ((_, *cells),) = mse_table(comparison, one_episode).rows
    assert all(cell.detail == "" for cell in cells)


def test_every_mean_over_the_states_is_beside_that_without_progress(comparison):
    units = [[column.unit for column in table.columns] for table in comparison_tables(comparison)]
    with_means = [each for each in units if "6 states" in each]
    assert len(with_means) == 2 * (1 + 1)
    for each in with_means:
        means = [unit for unit in each if unit in ("6 states", "without ds")]
        assert means == ["6 states", "without ds"] * (len(means) // 2)


def test_each_slice_names_its_best_linear_baseline_and_counts_what_is_in_it(comparison):
    table = conditions_table(comparison, "mdk-net")
    assert "of mdk-net" in table.title
    heads = [column.title for column in table.columns]
    (heading,), *rows = table.rows
    assert heading == "peak sideslip, deg"
    for row, label, count in zip(rows, ("0 to 9", "9 to 16"), ("20", "40"), strict=True):
        assert (row[0], row[heads.index("trajectories")]) == (label, count)
        assert row[heads.index("best linear")] == "lti-per-curvature"


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


def test_a_comparison_without_baselines_has_no_tables_of_ratios_to_them():
    comparison = compare_models({"m": with_random_error(MADE)}, {}, [made_test_set(MADE)], VEHICLE)
    titles = [table.title for table in comparison_tables(comparison)]
    assert not any("baseline" in title for title in titles)
