"""Models beside rivals: ratios of errors and what they rest on."""

import numpy as np
import pytest
from toy_predictors import Off, judged_on, made_trajectories, scattered

from offline.judgement import (
    FAIR_LTI,
    growth_from_library,
    is_within_goal,
    judge,
    ratios_to_rivals,
    worst_state,
)
from rt_controller.contract.schema import VEHICLE

MADE = made_trajectories(100)
LIBRARY = judged_on(MADE)


def ratios(model, **rivals):
    judgement = judge({"model": model}, rivals, [LIBRARY], VEHICLE)
    return ratios_to_rivals(judgement, "model")


def test_ratio_of_identical_models_is_exactly_1_with_an_interval_of_no_width():
    (found,) = ratios(scattered(MADE), twin=scattered(MADE)).values()
    for part in (*found.by_state, *found.geometric_mean):
        assert np.all(part == 1.0)


def test_a_rival_with_all_errors_doubled_is_exactly_four_times_worse_in_every_draw():
    """The draws are the same for both: what a hard episode does to both cancels."""
    (found,) = ratios(scattered(MADE), twice=scattered(MADE, factor=2.0)).values()
    for part in (*found.by_state, *found.geometric_mean):
        assert np.allclose(part, 4.0, rtol=1e-12)


def test_models_that_err_independently_have_an_interval():
    (found,) = ratios(scattered(MADE), other=scattered(MADE, seed=1)).values()
    assert np.all(found.by_state.low < found.by_state.value)
    assert np.all(found.by_state.value < found.by_state.high)
    assert found.geometric_mean.low < 1.0 < found.geometric_mean.high


def test_geometric_mean_is_over_all_states():
    rival = scattered(MADE).predict(MADE.x[:, 0].astype(float), None, None, None) - MADE.x
    rival[..., 0] *= 8.0
    (found,) = ratios(scattered(MADE), one_state_worse=Off(MADE, rival)).values()
    assert found.by_state.value == pytest.approx([64.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert found.geometric_mean.value == pytest.approx(2.0)


def test_the_fair_linear_rival_is_in_each_state_the_better_of_the_two():
    def off_by(*factors):
        return Off(MADE, np.array(factors))

    found = ratios(
        off_by(1, 1, 1, 1, 1, 1),
        **{"lti": off_by(2, 3, 2, 3, 2, 3), "lti-per-curvature": off_by(3, 2, 3, 2, 3, 1)},
        persistence=off_by(1, 1, 1, 1, 1, 1),
    )
    assert next(iter(found)) == FAIR_LTI
    assert found[FAIR_LTI].by_state.value == pytest.approx([4.0, 4.0, 4.0, 4.0, 4.0, 1.0])
    assert set(found) == {FAIR_LTI, "lti", "lti-per-curvature", "persistence"}


def test_the_fair_linear_rival_is_chosen_anew_in_each_draw():
    """Two rivals of one quality: the better of them is better than either, as often as drawn."""
    linear = {"lti": scattered(MADE, seed=1), "lti-per-curvature": scattered(MADE, seed=2)}
    found = ratios(scattered(MADE), **linear)
    for name in linear:
        assert np.all(found[FAIR_LTI].by_state.high <= found[name].by_state.high)
        assert np.all(found[FAIR_LTI].by_state.low <= found[name].by_state.low)


def test_without_linear_rivals_there_is_no_fair_one():
    assert set(ratios(scattered(MADE), other=scattered(MADE, seed=1))) == {"other"}


def test_a_rival_that_blew_up_is_infinitely_worse_and_does_not_spoil_the_others():
    error = np.zeros(MADE.x.shape)
    error[7, 5:] = np.nan
    found = ratios(scattered(MADE), broken=Off(MADE, error), twin=scattered(MADE))
    assert np.all(np.isinf(found["broken"].by_state.value))
    assert np.all(found["twin"].by_state.value == 1.0)


def test_growth_on_another_set_is_measured_against_the_library():
    far = made_trajectories(50, seed=3)
    both = MADE._replace(**{n: np.concatenate([getattr(MADE, n), getattr(far, n)]) for n in "x"})
    error = np.ones(both.x.shape)
    error[100:] = [2.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    sets = [LIBRARY, judged_on(far, name="robustness")]
    judgement = judge({"model": Off(both, error)}, {}, sets, VEHICLE)
    growth = growth_from_library(judgement, "model", "robustness")
    assert growth.by_state.value == pytest.approx([4.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert worst_state(growth) == 0
    assert not is_within_goal(growth.by_state)
    assert is_within_goal(growth_from_library(judgement, "model", "library").by_state)


def test_a_model_that_blows_up_on_both_sets_misses_the_goal():
    error = np.ones(MADE.x.shape)
    error[..., 2] = np.inf
    sets = [LIBRARY, judged_on(MADE, name="new-roads")]
    growth = growth_from_library(
        judge({"model": Off(MADE, error)}, {}, sets, VEHICLE), "model", "new-roads"
    )
    assert worst_state(growth) == 2
    assert not is_within_goal(growth.by_state)
