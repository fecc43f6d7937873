"""A slow car against its pedals."""

import pytest

from rt_controller.contract.signals import NEUTRAL_INPUT
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.pedal_effect import HILL_MPS2, LAG_S, PedalEffect

OPEN = NEUTRAL_INPUT._replace(throttle=0.5)
BRAKED = NEUTRAL_INPUT._replace(brake_n=40.0)


def test_a_car_that_answers_its_pedals_misses_no_speed() -> None:
    effect, pedals_mps2, v_mps = PedalEffect(8.0, 0.05), 0.0, 0.0
    for _ in range(60):
        pedals_mps2 += PERIOD_S / LAG_S * (4.0 - pedals_mps2)
        before, v_mps = v_mps, v_mps + PERIOD_S * pedals_mps2
        assert effect.missing_mps(OPEN, before, v_mps, 1) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("v_mps", [0.0, 3.0])
def test_a_speed_that_stays_while_the_throttle_is_open_is_missed_more_and_more(
    v_mps: float,
) -> None:
    effect = PedalEffect(8.0, 0.05)
    found = [effect.missing_mps(OPEN, v_mps, v_mps, 1) for _ in range(120)]
    assert found == sorted(found)
    assert found[-1] == pytest.approx(4.0 - HILL_MPS2, rel=0.1)


@pytest.mark.parametrize("part", [0.11, 0.5, 2.0])
def test_another_car_that_answers_its_throttle_misses_nothing(part: float) -> None:
    effect, v_mps = PedalEffect(8.0, 0.05), 0.0
    for _ in range(120):
        before, v_mps = v_mps, v_mps + PERIOD_S * part * (4.0 - HILL_MPS2)
        assert effect.missing_mps(OPEN, before, v_mps, 1) == 0.0


def test_a_car_that_the_throttle_holds_on_a_hill_misses_nothing() -> None:
    effect = PedalEffect(8.0, 0.05)
    held = NEUTRAL_INPUT._replace(throttle=HILL_MPS2 / 8.0)
    assert all(effect.missing_mps(held, 0.0, 0.0, 1) == 0.0 for _ in range(120))


def test_a_braked_car_that_stands_misses_nothing() -> None:
    effect = PedalEffect(8.0, 0.05)
    assert all(effect.missing_mps(BRAKED, 0.0, 0.0, 1) == 0.0 for _ in range(40))
    assert effect.missing_mps(OPEN, 0.0, 0.0, 1) == 0.0  # the brake is still being released


def test_the_brake_takes_away_from_the_throttle() -> None:
    wide = NEUTRAL_INPUT._replace(throttle=0.75)
    both = wide._replace(brake_n=40.0)  # as OPEN alone
    effects = PedalEffect(8.0, 0.05), PedalEffect(8.0, 0.05)
    for _ in range(40):
        assert effects[0].missing_mps(both, 0.0, 0.0, 1) == effects[1].missing_mps(
            OPEN, 0.0, 0.0, 1
        )


def test_several_periods_count_once_each_and_a_new_drive_begins_with_none() -> None:
    effect = PedalEffect(8.0, 0.05)
    one = effect.missing_mps(OPEN, 0.0, 0.0, 20)
    assert one == pytest.approx(20 * PERIOD_S * (4.0 - HILL_MPS2))
    assert effect.missing_mps(NEUTRAL_INPUT, 0.0, 0.0, 60) == 0.0  # all is forgotten
    effect.missing_mps(OPEN, 0.0, 0.0, 20)
    effect.begin()
    assert effect.missing_mps(NEUTRAL_INPUT, 0.0, 0.0, 1) == 0.0
