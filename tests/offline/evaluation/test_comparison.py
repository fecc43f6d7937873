"""Ratios of errors between models and baselines."""

import numpy as np
import pytest
from toy_predictors import WithError, made_test_set, made_trajectories, with_random_error

from offline.evaluation.comparison import FAIR_LTI, compare_models
from offline.evaluation.series import Series, Slice
from rt_controller.contract.signals import VEHICLE

MADE = made_trajectories(100)
LIBRARY = made_test_set(MADE)


def constant(*errors):
    return WithError(MADE, np.array(errors, dtype=float))


def compared(model, baselines, sets=(LIBRARY,), **options):
    return compare_models({"model": model}, baselines, sets, VEHICLE, **options)


def ratios(model, **baselines):
    return compared(model, baselines).library["baseline_mse_over_model_mse"]["model"]


def states_of(ratio, part="value"):
    return np.array([each[part] for each in ratio.values()])[:6]


def mean_of(ratio, part="value"):
    return ratio["geometric_mean"][part]


@pytest.mark.parametrize(("factor", "ratio"), [(1.0, 1.0), (2.0, 4.0)])
def test_proportional_errors_have_an_exact_ratio_because_the_draws_are_the_same(factor, ratio):
    (found,) = ratios(with_random_error(MADE), other=with_random_error(MADE, factor)).values()
    assert np.allclose([[*each.values()] for each in found.values()], ratio, rtol=1e-12)


def test_fair_lti_is_in_each_state_the_better_of_the_two_linear_baselines():
    found = ratios(
        constant(1, 1, 1, 1, 1, 1),
        **{"lti": constant(2, 3, 2, 3, 2, 3), "lti-per-curvature": constant(3, 2, 3, 2, 3, 1)},
        persistence=constant(1, 1, 1, 1, 1, 1),
    )
    assert list(found) == [FAIR_LTI, "lti", "lti-per-curvature", "persistence"]
    assert states_of(found[FAIR_LTI]) == pytest.approx([4.0, 4.0, 4.0, 4.0, 4.0, 1.0])


def test_the_best_linear_baseline_has_the_smallest_geometric_mean():
    baselines = {
        "slow": constant(9, 1, 1, 1, 1, 1),
        "blind": constant(1, 2, 2, 1, 1, 1),
        "gru": constant(1, 1, 1, 1, 1, 2),
        "guess": constant(1, 1, 1, 1, 1, 1),
    }
    classes = {"slow": "linear", "blind": "linear", "gru": "recurrent", "guess": "other"}
    comparison = compared(constant(1, 1, 1, 1, 1, 1), baselines, classes=classes)
    assert comparison.library["best_baseline"] == {"linear": "blind"}


def test_the_best_baseline_is_chosen_for_each_slice():
    error = np.ones(MADE.x.shape)
    error[:50] = 3.0
    rows = np.arange(100) < 50
    slices = (Slice("first", "library", rows), Slice("last", "library", ~rows))
    comparison = compared(
        with_random_error(MADE),
        {"a": WithError(MADE, error), "b": WithError(MADE, 4.0 - error)},
        classes={"a": "linear", "b": "linear"},
        series=[Series("half", "half", "", "library", slices)],
    )
    found = comparison.figures["series"]["half"]["slices"]
    assert [part["best_baseline"]["linear"] for part in found] == ["b", "a"]
    assert [(part["n_trajectories"], part["n_episodes"]) for part in found] == [(50, 10)] * 2
    assert mean_of(found[0]["mse_over_library_mse"]["a"]) == pytest.approx(1.8)


def test_the_smallest_ratio_of_a_slice_is_that_of_the_state_where_the_model_leads_least():
    baselines = {"other": constant(4, 3, np.nan, 9, 2, np.inf)}
    series = [Series("all", "all", "", "", (Slice("all", "library", np.ones(100, dtype=bool)),))]
    comparison = compared(constant(1, 1, 1, 1, 1, 1), baselines, series=series)
    (found,) = comparison.figures["series"]["all"]["slices"]
    assert found["state_of_smallest_ratio"] == {"model": {"other": "ey"}}


@pytest.mark.parametrize(("names", "best"), [(("broken", "fine"), "fine"), (("broken",), "broken")])
def test_a_diverging_baseline_is_the_best_linear_one_only_if_there_is_no_other(names, best):
    error = np.ones(MADE.x.shape)
    error[3, 4:, 2] = np.nan
    known = {"broken": WithError(MADE, error), "fine": with_random_error(MADE, 100.0)}
    baselines = {name: known[name] for name in names}
    classes = dict.fromkeys(names, "linear")
    comparison = compare_models({}, baselines, [LIBRARY], VEHICLE, classes=classes)
    assert comparison.library["best_baseline"] == {"linear": best}


def test_errors_on_another_set_are_divided_by_those_on_the_library():
    error = [2.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    far = made_trajectories(50, seed=3)
    both = MADE._replace(x=np.concatenate([MADE.x, far.x]))
    errors = np.ones(both.x.shape)
    errors[100:] = error
    sets = [LIBRARY, made_test_set(far, name="new-roads")]
    comparison = compared(WithError(both, errors), {}, sets)
    found = comparison.figures["sets"]["new-roads"]
    ratio = found["mse_over_library_mse"]["model"]
    assert states_of(ratio) == pytest.approx(np.square(error))
