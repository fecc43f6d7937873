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


def test_loss_of_the_kept_model_is_the_lowest_only_if_the_rule_keeps_the_lowest():
    history = [1.0, 0.2, 0.9, 0.8]
    assert loss_of_kept_model(history, PATIENCE, keep_as_printed) == 0.8
    assert loss_of_kept_model(history, PATIENCE, keep_lowest) == 0.2


@given(losses)
def test_default_rule_keeps_the_model_of_the_lowest_loss(history):
    assert loss_of_kept_model(history, PATIENCE, keep_lowest) == min(history)


def test_default_rule_halves_after_every_third_evaluation_without_a_best():
    history, halved = [1.0], []
    for k in range(7):
        history.append(2.0)
        if keep_lowest(history, PATIENCE).lower_rate:
            halved.append(k + 1)
    assert halved == [3, 6]


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
    assert paper.target_samples is None
