"""A slow car against its pedals."""

import pytest

from rt_controller.contract.signals import NEUTRAL_INPUT
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.coast_model import HILL_MPS2, LAG_S, OPEN_MPS2, PedalEffect

OPEN = NEUTRAL_INPUT._replace(throttle=0.5)
BRAKED = NEUTRAL_INPUT._replace(brake_n=40.0)


def test_a_car_that_answers_its_pedals_misses_no_speed() -> None:
    effect, pedals_mps2, v_mps = PedalEffect(OPEN_MPS2, 0.05), 0.0, 0.0
    for _ in range(60):
        pedals_mps2 += PERIOD_S / LAG_S * (3.0 - pedals_mps2)
        before, v_mps = v_mps, v_mps + PERIOD_S * pedals_mps2
        assert effect.missing_mps(OPEN, before, v_mps, 1) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("v_mps", [0.0, 3.0])
def test_a_speed_that_stays_while_the_throttle_is_open_is_missed_more_and_more(
    v_mps: float,
) -> None:
    effect = PedalEffect(OPEN_MPS2, 0.05)
    found = [effect.missing_mps(OPEN, v_mps, v_mps, 1) for _ in range(120)]
    assert found == sorted(found)
    assert found[-1] == pytest.approx(3.0 - HILL_MPS2, rel=0.1)


@pytest.mark.parametrize("part", [0.05, 0.5, 2.0])
def test_another_car_that_answers_its_throttle_misses_nothing(part: float) -> None:
    effect, v_mps = PedalEffect(OPEN_MPS2, 0.05), 0.0
    for _ in range(120):
        before, v_mps = v_mps, v_mps + PERIOD_S * part * (3.0 - HILL_MPS2)
        assert effect.missing_mps(OPEN, before, v_mps, 1) == 0.0


def test_a_car_that_the_throttle_holds_on_a_hill_misses_nothing() -> None:
    effect = PedalEffect(OPEN_MPS2, 0.05)
    held = NEUTRAL_INPUT._replace(throttle=HILL_MPS2 / OPEN_MPS2)
    assert all(effect.missing_mps(held, 0.0, 0.0, 1) == 0.0 for _ in range(120))


def test_a_braked_car_that_stands_misses_nothing() -> None:
    effect = PedalEffect(OPEN_MPS2, 0.05)
    assert all(effect.missing_mps(BRAKED, 0.0, 0.0, 1) == 0.0 for _ in range(40))
    assert effect.missing_mps(OPEN, 0.0, 0.0, 1) == 0.0  # the brake is still being released


def test_the_brake_takes_away_from_the_throttle() -> None:
    wide = NEUTRAL_INPUT._replace(throttle=0.75)
    both = wide._replace(brake_n=30.0)  # as OPEN alone
    effects = PedalEffect(OPEN_MPS2, 0.05), PedalEffect(OPEN_MPS2, 0.05)
    for _ in range(40):
        braked, alone = (
            effect.missing_mps(pedals, 0.0, 0.0, 1)
            for effect, pedals in zip(effects, (both, OPEN), strict=True)
        )
        assert braked == pytest.approx(alone)
    assert alone > 0.1


def test_several_periods_count_once_each_and_a_new_drive_begins_with_none() -> None:
    effect = PedalEffect(OPEN_MPS2, 0.05)
    one = effect.missing_mps(OPEN, 0.0, 0.0, 20)
    assert one == pytest.approx(20 * PERIOD_S * (3.0 - HILL_MPS2))
    assert effect.missing_mps(NEUTRAL_INPUT, 0.0, 0.0, 60) == 0.0  # all is forgotten
    effect.missing_mps(OPEN, 0.0, 0.0, 20)
    effect.begin()
    assert effect.missing_mps(NEUTRAL_INPUT, 0.0, 0.0, 1) == 0.0


def test_a_speed_that_hardly_changes_is_missed() -> None:
    effect, v_mps = PedalEffect(OPEN_MPS2, 0.05), 0.0
    for _ in range(120):
        before, v_mps = v_mps, v_mps + PERIOD_S * 0.03 * (3.0 - HILL_MPS2)
        found = effect.missing_mps(OPEN, before, v_mps, 1)
    assert found > 0.8


@pytest.mark.parametrize("throttle_mps2", [1.5, 3.0, 9.0])
def test_of_a_weaker_or_stronger_car_the_same_share_is_missing(throttle_mps2: float) -> None:
    effects = PedalEffect(OPEN_MPS2, 0.05), PedalEffect(throttle_mps2, 0.05)
    for _ in range(80):
        usual, other = (effect.missing_mps(OPEN, 0.0, 0.0, 1) for effect in effects)
    assert other == pytest.approx(usual)
