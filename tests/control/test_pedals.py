"""One foot, two pedals."""

import numpy as np
import pytest

from rt_controller.control.pedals import Pedal, PedalChoice, lower_ceilings

SLEW = np.array([0.0625, 0.0833, 0.1])


def ceilings(choice: PedalChoice, throttle: float, brake: float) -> np.ndarray:
    upper = np.ones((20, 3))
    lower_ceilings(upper, choice, np.array([throttle, brake, 0.0]), SLEW)
    return upper


def test_the_throttle_is_the_pedal_of_cruising() -> None:
    choice = PedalChoice()
    choice.update(speed_error_mps=0.5, wanted_mps2=0.0)
    assert choice.pedal is Pedal.THROTTLE
    upper = ceilings(choice, throttle=0.2, brake=0.0)
    assert np.all(upper[:, Pedal.THROTTLE] == 1.0)
    assert np.all(upper[:, Pedal.BRAKE] == 0.0)


@pytest.mark.parametrize(("speed_error_mps", "wanted_mps2"), [(1.5, 0.0), (0.0, -2.0)])
def test_too_fast_or_told_to_slow_down_means_brake(
    speed_error_mps: float, wanted_mps2: float
) -> None:
    choice = PedalChoice()
    choice.update(speed_error_mps, wanted_mps2)
    assert choice.pedal is Pedal.BRAKE


def test_the_choice_does_not_chatter_between_its_thresholds() -> None:
    choice = PedalChoice()
    choice.update(1.5, 0.0)
    choice.update(0.6, 0.0)
    assert choice.pedal is Pedal.BRAKE
    choice.update(0.1, 0.0)
    assert choice.pedal is Pedal.THROTTLE
    choice.update(0.6, 0.0)
    assert choice.pedal is Pedal.THROTTLE


def test_the_brake_waits_until_the_throttle_is_up_and_the_foot_is_there() -> None:
    choice = PedalChoice()
    choice.update(2.0, 0.0)
    upper = ceilings(choice, throttle=0.5, brake=0.0)
    throttle_up = np.flatnonzero(upper[:, Pedal.THROTTLE] == 0.0)[0]
    brake_free = np.flatnonzero(upper[:, Pedal.BRAKE] > 0.0)[0]
    assert throttle_up == 7  # 0.5 / 0.0625 = 8 periods
    assert brake_free == 8
    assert np.all(np.diff(upper[: throttle_up + 1, Pedal.THROTTLE]) >= -SLEW[0] - 1e-12)


def test_an_untouched_throttle_still_costs_the_foot_its_way() -> None:
    choice = PedalChoice()
    choice.update(2.0, 0.0)
    upper = ceilings(choice, throttle=0.0, brake=0.0)
    assert np.all(upper[:6, Pedal.BRAKE] == 0.0)  # 0.15 s
    assert np.all(upper[6:, Pedal.BRAKE] == 1.0)


def test_a_pressed_pedal_is_never_taken_away_from_under_the_foot() -> None:
    choice = PedalChoice()
    choice.update(2.0, 0.0)
    choice.update(0.0, 0.0)
    upper = ceilings(choice, throttle=0.3, brake=0.0)
    assert np.all(upper[:, Pedal.THROTTLE] == 1.0)
