"""Only one pedal is pressed, and changing pedals takes time."""

import numpy as np
import pytest

from rt_controller.contract.limits import PEDAL_CHANGE_S
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.pedals import Pedal, PedalChoice, limit_pedals

SLEW = np.array([0.0625, 0.0833, 0.1])
EVERY_PERIOD = np.arange(1, 21)


def ceilings(
    choice: PedalChoice, throttle: float, brake: float, periods: np.ndarray = EVERY_PERIOD
) -> np.ndarray:
    upper = np.ones((len(periods), 3))
    limit_pedals(upper, periods, choice, np.array([throttle, brake, 0.0]), SLEW)
    return upper


def test_at_constant_speed_the_throttle_is_chosen() -> None:
    choice = PedalChoice()
    choice.update(speed_error_mps=0.5, reference_mps2=0.0)
    assert choice.pedal is Pedal.THROTTLE
    upper = ceilings(choice, throttle=0.2, brake=0.0)
    assert np.all(upper[:, Pedal.THROTTLE] == 1.0)
    assert np.all(upper[:, Pedal.BRAKE] == 0.0)


@pytest.mark.parametrize(("speed_error_mps", "reference_mps2"), [(1.5, 0.0), (0.0, -2.0)])
def test_the_brake_is_chosen_if_too_fast_or_if_the_reference_decelerates(
    speed_error_mps: float, reference_mps2: float
) -> None:
    choice = PedalChoice()
    choice.update(speed_error_mps, reference_mps2)
    assert choice.pedal is Pedal.BRAKE


def test_between_its_thresholds_the_choice_does_not_change() -> None:
    choice = PedalChoice()
    choice.update(1.5, 0.0)
    choice.update(0.6, 0.0)
    assert choice.pedal is Pedal.BRAKE
    choice.update(0.1, 0.0)
    assert choice.pedal is Pedal.THROTTLE
    choice.update(0.6, 0.0)
    assert choice.pedal is Pedal.THROTTLE


def test_the_brake_is_released_for_use_after_the_throttle_is_closed() -> None:
    choice = PedalChoice()
    choice.update(2.0, 0.0)
    upper = ceilings(choice, throttle=0.5, brake=0.0)
    throttle_up = np.flatnonzero(upper[:, Pedal.THROTTLE] == 0.0)[0]
    brake_free = np.flatnonzero(upper[:, Pedal.BRAKE] > 0.0)[0]
    assert throttle_up == 7  # 0.5 / 0.0625 = 8 periods
    assert brake_free == 8
    assert np.all(np.diff(upper[: throttle_up + 1, Pedal.THROTTLE]) >= -SLEW[0] - 1e-12)


def test_with_the_throttle_closed_the_brake_still_waits_for_the_change_of_pedal() -> None:
    choice = PedalChoice()
    choice.update(2.0, 0.0)
    upper = ceilings(choice, throttle=0.0, brake=0.0)
    ticks = round(PEDAL_CHANGE_S / PERIOD_S)
    assert np.all(upper[:ticks, Pedal.BRAKE] == 0.0)
    assert np.all(upper[ticks:, Pedal.BRAKE] == 1.0)


def test_the_upper_bound_of_the_pedal_in_use_stays() -> None:
    choice = PedalChoice()
    choice.update(2.0, 0.0)
    choice.update(0.0, 0.0)
    upper = ceilings(choice, throttle=0.3, brake=0.0)
    assert np.all(upper[:, Pedal.THROTTLE] == 1.0)


def test_knots_have_the_bounds_of_their_stages() -> None:
    choice = PedalChoice()
    choice.update(2.0, 0.0)
    knots = np.array([1, 4, 7, 8, 9, 20])
    every_stage = ceilings(choice, throttle=0.5, brake=0.0)
    found = ceilings(choice, throttle=0.5, brake=0.0, periods=knots)
    np.testing.assert_array_equal(found, every_stage[knots - 1])
