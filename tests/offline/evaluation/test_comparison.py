"""The table of an evaluation: errors of models and baselines on parts, and their ratios."""

import numpy as np
import pytest
from toy_predictors import WithError, made_test_set, made_trajectories, with_random_error

from offline.evaluation.comparison import FAIR_LTI, compare_models
from offline.evaluation.parts import Part, whole_part
from rt_controller.contract.signals import VEHICLE

MADE = made_trajectories(100)
LIBRARY = whole_part(made_test_set(MADE))


def constant(*errors):
    return WithError(MADE, np.array(errors, dtype=float))


def compared(model, baselines, parts=(LIBRARY,), **options):
    return compare_models({"model": model}, baselines, parts, VEHICLE, **options)


def ratios_of(rows):
    return [row.over_reference for row in rows[:6]]


@pytest.mark.parametrize(("factor", "ratio"), [(1.0, 1.0), (2.0, 4.0)])
def test_proportional_errors_have_an_exact_ratio_because_the_draws_are_the_same(factor, ratio):
    baselines = {"other": with_random_error(MADE, factor)}
    for row in compared(with_random_error(MADE), baselines).library["other"]:
        found = row.over_reference, row.over_reference_low, row.over_reference_high
        assert np.allclose(found, ratio, rtol=1e-12)


def test_fair_lti_is_in_each_state_the_better_of_the_two_linear_baselines():
    found = compared(
        constant(1, 1, 1, 1, 1, 1),
        {
            "lti": constant(2, 3, 2, 3, 2, 3),
            "lti-per-curvature": constant(3, 2, 3, 2, 3, 1),
            "persistence": constant(1, 1, 1, 1, 1, 1),
        },
    ).library
    assert list(found) == ["model", FAIR_LTI, "lti", "lti-per-curvature", "persistence"]
    assert ratios_of(found[FAIR_LTI]) == pytest.approx([4.0, 4.0, 4.0, 4.0, 4.0, 1.0])


def test_the_best_linear_baseline_has_the_smallest_geometric_mean():
    baselines = {
        "slow": constant(9, 1, 1, 1, 1, 1),
        "blind": constant(1, 2, 2, 1, 1, 1),
        "guess": constant(1, 1, 1, 1, 1, 1),
    }
    linear = ("slow", "blind")
    comparison = compared(constant(1, 1, 1, 1, 1, 1), baselines, linear=linear)
    assert comparison.best_linear("library") == "blind"


def test_the_best_baseline_is_chosen_for_each_part():
    error = np.ones(MADE.x.shape)
    error[:50] = 3.0
    first = np.arange(100) < 50
    comparison = compared(
        with_random_error(MADE),
        {"a": WithError(MADE, error), "b": WithError(MADE, 4.0 - error)},
        [LIBRARY, Part("first", "", LIBRARY.test, first), Part("last", "", LIBRARY.test, ~first)],
        linear=("a", "b"),
    )
    parts = comparison.figures()["parts"][1:]
    assert [part["best_linear"] for part in parts] == ["b", "a"]
    assert [(part["trajectories"], part["episodes"]) for part in parts] == [(50, 10)] * 2
    assert comparison.table["first", "a"][6].over_library == pytest.approx(1.8)


@pytest.mark.parametrize(("names", "best"), [(("broken", "fine"), "fine"), (("broken",), "broken")])
def test_a_diverging_baseline_is_the_best_linear_one_only_if_there_is_no_other(names, best):
    error = np.ones(MADE.x.shape)
    error[3, 4:, 2] = np.nan
    known = {"broken": WithError(MADE, error), "fine": with_random_error(MADE, 100.0)}
    baselines = {name: known[name] for name in names}
    comparison = compare_models({}, baselines, [LIBRARY], VEHICLE, linear=names)
    assert comparison.best_linear("library") == best


def test_errors_on_another_set_are_divided_by_those_on_the_library():
    error = [2.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    far = made_trajectories(50, seed=3)
    both = MADE._replace(x=np.concatenate([MADE.x, far.x]))
    errors = np.ones(both.x.shape)
    errors[100:] = error
    parts = [LIBRARY, whole_part(made_test_set(far, name="new-roads"))]
    rows = compared(WithError(both, errors), {}, parts).table["new-roads", "model"]
    assert [row.over_library for row in rows[:6]] == pytest.approx(np.square(error))
