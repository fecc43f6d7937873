"""A steering wheel that moves, but not to the commanded angle."""

import pytest

from rt_controller.contract.limits import INPUT_LIMITS
from sim_bridge.steering_response import SAMPLES, SteeringResponse

COMMANDED = [0.1, 0.15, 0.2, 0.22, 0.24, 0.2]


def after(pairs: list[tuple[float, float]]) -> SteeringResponse:
    response = SteeringResponse()
    for commanded_rad, applied_rad in pairs:
        response.note(commanded_rad, applied_rad)
    return response


@pytest.mark.parametrize(
    ("factor", "offset_rad"), [(1.0, 0.3), (0.5, 0.0), (-1.0, 0.0), (1.4, 0.1)]
)
def test_the_wheel_is_led_to_where_it_has_to_be(factor: float, offset_rad: float) -> None:
    response = after([(a, factor * a + offset_rad) for a in COMMANDED * 2])
    assert response.is_correcting
    commanded_rad = response.command_for(0.1)
    assert factor * commanded_rad + offset_rad == pytest.approx(0.1)


def test_an_offset_is_known_while_the_wheel_stands() -> None:
    response = after([(0.0, 0.1)] * 2 * SAMPLES)
    assert response.command_for(0.05) == pytest.approx(-0.05)


def test_the_command_of_a_wheel_that_follows_is_not_changed() -> None:
    response = after([(a, a + 0.02) for a in COMMANDED])
    assert not response.is_correcting
    assert response.command_for(0.3) == 0.3


@pytest.mark.parametrize(
    "pairs",
    [
        [(a, 0.0) for a in COMMANDED],
        [(a, a + 0.1 * (-1) ** k) for k, a in enumerate(COMMANDED)],
        [(a, 5.0 * a) for a in COMMANDED],
        [(0.0, 0.1)] * (SAMPLES - 1),
    ],
)
def test_an_answer_that_is_not_identified_is_not_corrected(
    pairs: list[tuple[float, float]],
) -> None:
    response = after(pairs)
    assert not response.is_correcting
    assert response.command_for(0.3) == 0.3


def test_a_wheel_that_turns_at_a_largest_rate_is_slow_and_not_corrected() -> None:
    response = after([(0.1 * k, 0.02 * k) for k in range(10)])
    assert response.is_slow
    assert not response.is_correcting


def test_a_wheel_that_gets_stuck_later_is_not_identified() -> None:
    response = after([*[(0.0, 0.1)] * SAMPLES, (-0.1, 0.1), (-0.2, 0.1)])
    assert response.is_correcting
    assert not response.is_identified


def test_the_command_stays_within_the_bounds_after_one_period_at_zero() -> None:
    response = after([(a, a + 0.4) for a in COMMANDED * 2])
    assert response.command_for(-0.6) == 0.0
    assert response.command_for(-0.6) == INPUT_LIMITS.lower.steer_rad
