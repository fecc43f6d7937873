"""Ratios of errors between models and baselines."""

import numpy as np
import pytest
from toy_predictors import WithError, made_test_set, made_trajectories, with_random_error

from offline.evaluation.comparison import FAIR_LTI, compare_models
from offline.evaluation.series import Series, Slice
from rt_controller.contract.signals import VEHICLE

MADE = made_trajectories(100)
LIBRARY = made_test_set(MADE)


def ratios(model, **baselines):
    comparison = compare_models({"model": model}, baselines, [LIBRARY], VEHICLE)
    return comparison.ratios_to_baselines("model")


@pytest.mark.parametrize(("factor", "ratio"), [(1.0, 1.0), (2.0, 4.0)])
def test_proportional_errors_have_an_exact_ratio_because_the_draws_are_the_same(factor, ratio):
    (found,) = ratios(with_random_error(MADE), other=with_random_error(MADE, factor)).values()
    for part in (*found.by_state, *found.geometric_mean):
        assert np.allclose(part, ratio, rtol=1e-12)


def test_ratio_of_independent_errors_has_an_interval():
    (found,) = ratios(with_random_error(MADE), other=with_random_error(MADE, seed=1)).values()
    assert np.all(found.by_state.low < found.by_state.value)
    assert np.all(found.by_state.value < found.by_state.high)
    assert found.geometric_mean.low < 1.0 < found.geometric_mean.high


def test_geometric_mean_is_over_all_states():
    model = with_random_error(MADE)
    error = model.predict(MADE.x[:, 0].astype(float), None, None, None) - MADE.x
    error[..., 0] *= 8.0
    (found,) = ratios(model, one_state_worse=WithError(MADE, error)).values()
    assert found.by_state.value == pytest.approx([64.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert found.geometric_mean.value == pytest.approx(2.0)


def test_fair_lti_is_in_each_state_the_better_of_the_two_linear_baselines():
    def constant(*errors):
        return WithError(MADE, np.array(errors))

    found = ratios(
        constant(1, 1, 1, 1, 1, 1),
        **{"lti": constant(2, 3, 2, 3, 2, 3), "lti-per-curvature": constant(3, 2, 3, 2, 3, 1)},
        persistence=constant(1, 1, 1, 1, 1, 1),
    )
    assert next(iter(found)) == FAIR_LTI
    assert found[FAIR_LTI].by_state.value == pytest.approx([4.0, 4.0, 4.0, 4.0, 4.0, 1.0])
    assert set(found) == {FAIR_LTI, "lti", "lti-per-curvature", "persistence"}


def test_fair_lti_is_chosen_anew_in_each_draw():
    linear = {
        "lti": with_random_error(MADE, seed=1),
        "lti-per-curvature": with_random_error(MADE, seed=2),
    }
    found = ratios(with_random_error(MADE), **linear)
    for name in linear:
        assert np.all(found[FAIR_LTI].by_state.high <= found[name].by_state.high)
        assert np.all(found[FAIR_LTI].by_state.low <= found[name].by_state.low)


def test_the_best_linear_baseline_has_the_smallest_geometric_mean():
    def constant(*errors):
        return WithError(MADE, np.array(errors, dtype=float))

    baselines = {
        "slow": constant(9, 1, 1, 1, 1, 1),
        "blind": constant(1, 2, 2, 1, 1, 1),
        "gru": constant(1, 1, 1, 1, 1, 2),
        "guess": constant(1, 1, 1, 1, 1, 1),
    }
    comparison = compare_models(
        {"model": constant(1, 1, 1, 1, 1, 1)},
        baselines,
        [LIBRARY],
        VEHICLE,
        classes={"slow": "linear", "blind": "linear", "gru": "recurrent", "guess": "other"},
    )
    assert comparison.best_linear(comparison.errors_on("library")) == "blind"


def test_the_best_baseline_is_chosen_for_each_slice():
    error = np.ones(MADE.x.shape)
    error[:50] = 3.0
    rows = np.arange(100) < 50
    slices = (Slice("first", "library", rows), Slice("last", "library", ~rows))
    comparison = compare_models(
        {"model": with_random_error(MADE)},
        {"a": WithError(MADE, error), "b": WithError(MADE, 4.0 - error)},
        [LIBRARY],
        VEHICLE,
        classes={"a": "linear", "b": "linear"},
        series=[Series("half", "half", "", "library", slices)],
    )
    errors = [comparison.errors_in(part) for part in slices]
    assert [comparison.best_linear(each) for each in errors] == ["b", "a"]
    assert [comparison.size_of(part) for part in slices] == [(50, 10), (50, 10)]
    assert comparison.growth("a", errors[0]["a"]).geometric_mean.value == pytest.approx(1.8)


def test_a_diverging_baseline_is_the_best_linear_one_only_if_there_is_no_other():
    error = np.ones(MADE.x.shape)
    error[3, 4:, 2] = np.nan
    broken, fine = WithError(MADE, error), with_random_error(MADE, 100.0)
    for baselines, best in (
        ({"broken": broken, "fine": fine}, "fine"),
        ({"broken": broken}, "broken"),
    ):
        classes = dict.fromkeys(baselines, "linear")
        comparison = compare_models({}, baselines, [LIBRARY], VEHICLE, classes=classes)
        assert comparison.best_linear(comparison.errors_on("library")) == best


def test_ratios_of_medians_ignore_a_single_bad_trajectory():
    error = np.ones(MADE.x.shape)
    error[7] = 1e3
    baselines = {"other": WithError(MADE, 2.0 * np.ones(MADE.x.shape))}
    comparison = compare_models({"model": WithError(MADE, error)}, baselines, [LIBRARY], VEHICLE)
    by_share = comparison.ratios_of_quantiles("model")
    assert by_share[0.5]["other"].geometric_mean.value == pytest.approx(4.0)
    assert by_share[0.5]["other"].without_progress.value == pytest.approx(4.0)
    assert comparison.ratios_to_baselines("model")["other"].geometric_mean.value < 1e-3


def test_without_linear_baselines_there_is_no_fair_lti():
    assert set(ratios(with_random_error(MADE), other=with_random_error(MADE))) == {"other"}


def test_a_diverging_baseline_has_an_infinite_ratio_and_does_not_change_the_others():
    error = np.zeros(MADE.x.shape)
    error[7, 5:] = np.nan
    model = with_random_error(MADE)
    found = ratios(model, broken=WithError(MADE, error), equal=with_random_error(MADE))
    assert np.all(np.isinf(found["broken"].by_state.value))
    assert np.all(found["equal"].by_state.value == 1.0)


def test_errors_on_another_set_are_divided_by_those_on_the_library():
    far = made_trajectories(50, seed=3)
    both = MADE._replace(x=np.concatenate([MADE.x, far.x]))
    error = np.ones(both.x.shape)
    error[100:] = [2.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    sets = [LIBRARY, made_test_set(far, name="robustness")]
    comparison = compare_models({"model": WithError(both, error)}, {}, sets, VEHICLE)
    ratio = comparison.ratio_to_library("model", "robustness")
    assert ratio.by_state.value == pytest.approx([4.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert ratio.worst_state == 0
    assert not ratio.is_within_goal
    assert comparison.ratio_to_library("model", "library").is_within_goal


def test_a_model_that_diverges_on_both_sets_misses_the_goal():
    error = np.ones(MADE.x.shape)
    error[..., 2] = np.inf
    sets = [LIBRARY, made_test_set(MADE, name="new-roads")]
    comparison = compare_models({"model": WithError(MADE, error)}, {}, sets, VEHICLE)
    ratio = comparison.ratio_to_library("model", "new-roads")
    assert ratio.worst_state == 2
    assert not ratio.is_within_goal
