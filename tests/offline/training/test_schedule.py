"""The learning rate schedule."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from offline.training.optimizer import WARM_UP_SHARE, cosine_rate

HIGHEST = 2e-3
run_lengths = st.integers(1, 5000)
seeded = settings(max_examples=50, derandomize=True, deadline=None)


def rates(steps: int) -> list[float]:
    return [cosine_rate(step, steps, HIGHEST) for step in range(steps)]


@seeded
@given(run_lengths)
def test_the_cosine_rate_rises_to_its_maximum_and_then_falls(steps):
    found = rates(steps)
    top = found.index(max(found))
    assert found[: top + 1] == sorted(found[: top + 1])
    assert found[top:] == sorted(found[top:], reverse=True)
    assert found[top] == pytest.approx(HIGHEST)


@seeded
@given(run_lengths)
def test_the_rate_of_every_step_is_positive(steps):
    assert all(0.0 < rate <= HIGHEST * (1 + 1e-12) for rate in rates(steps))


def test_the_warm_up_is_linear_over_5_percent_of_the_steps():
    found = rates(1000)
    assert WARM_UP_SHARE == 0.05
    assert found[:50] == pytest.approx([HIGHEST * (k + 1) / 50 for k in range(50)])


def test_after_the_warm_up_the_rate_is_half_a_cosine():
    found = rates(1000)
    assert found[50] == pytest.approx(HIGHEST)
    assert found[50 + 475] == pytest.approx(HIGHEST / 2)
    assert found[50 + 950 // 4] == pytest.approx(
        HIGHEST * (1 + math.cos(math.pi * (950 // 4) / 950)) / 2
    )
    assert found[-1] < 1e-5 * HIGHEST
