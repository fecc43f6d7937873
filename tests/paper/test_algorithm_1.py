"""Algorithm 1: keeping the best model and lowering the rate; the paper's hyperparameters."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from offline.config import PRESETS
from offline.training.optimizer import keep_as_printed, keep_lowest, loss_of_kept_model

PATIENCE = 3
losses = st.lists(st.floats(0.0, 10.0), min_size=1, max_size=30)


def printed(L: list[float]) -> tuple[bool, bool]:
    """Algorithm 1, lines "if L_i > L_(i-1) > ... > L_(i-patience)" and "else if"."""
    i = len(L) - 1

    def before(j: int) -> float:
        return L[j] if j >= 0 else float("inf")

    if all(before(i - j) > before(i - j - 1) for j in range(PATIENCE)):
        return False, True
    return before(i) < before(i - 1), False


@given(losses)
def test_the_printed_rule_is_that_of_algorithm_1(history):
    assert tuple(keep_as_printed(history, PATIENCE)) == printed(history)


@given(losses)
def test_the_default_rule_keeps_a_model_only_if_its_loss_is_the_lowest(history):
    is_best = keep_lowest(history, PATIENCE).is_best
    assert is_best == (history[-1] < min(history[:-1], default=float("inf")))


def test_printed_rule_may_keep_a_worse_model_and_the_default_does_not():
    history = [1.0, 0.2, 0.9, 0.8]
    assert keep_as_printed(history, PATIENCE).is_best
    assert not keep_lowest(history, PATIENCE).is_best


def test_loss_of_the_kept_model_is_the_lowest_only_if_the_rule_keeps_the_lowest():
    history = [1.0, 0.2, 0.9, 0.8]
    assert loss_of_kept_model(history, PATIENCE, keep_as_printed) == 0.8
    assert loss_of_kept_model(history, PATIENCE, keep_lowest) == 0.2


@given(losses)
def test_default_rule_keeps_the_model_of_the_lowest_loss(history):
    assert loss_of_kept_model(history, PATIENCE, keep_lowest) == min(history)


def test_before_the_first_evaluation_no_model_is_kept():
    assert loss_of_kept_model([], PATIENCE, keep_as_printed) == float("inf")


def test_first_evaluation_is_always_the_best_so_far():
    assert keep_as_printed([5.0], PATIENCE).is_best
    assert keep_lowest([5.0], PATIENCE).is_best


def test_default_rule_halves_after_every_third_evaluation_without_a_best():
    history, halved = [1.0], []
    for k in range(7):
        history.append(2.0)
        if keep_lowest(history, PATIENCE).lower_rate:
            halved.append(k + 1)
    assert halved == [3, 6]


def test_a_new_best_restarts_the_count():
    history = [1.0, 2.0, 2.0, 0.5, 2.0, 2.0]
    assert not keep_lowest(history, PATIENCE).lower_rate
    assert keep_lowest([*history, 2.0], PATIENCE).lower_rate


@pytest.mark.parametrize("preset", ["paper", "paper-literal"])
def test_the_presets_of_the_paper_have_its_table_of_hyperparameters(preset):
    paper = PRESETS[preset]
    assert (paper.steps, paper.evaluate_every, paper.batch) == (60_000, 500, 128)
    assert (paper.latents, paper.hidden) == (60, (32, 64, 128, 128, 64))
    assert (paper.learning_rate, paper.patience, paper.forgetting) == (1e-3, 3, 0.9)
    alphas = (
        paper.weight_single_step,
        paper.weight_multi_step,
        paper.weight_stability,
        paper.weight_regularisation,
    )
    assert alphas == (1.0, 0.5, 1.6, 1e-4)
    assert (paper.decay_encoder, paper.decay_operator) == (0.9, 0.5)
