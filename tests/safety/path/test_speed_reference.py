"""The wanted speed against the wanted acceleration."""

import pytest

from rt_controller.contract.signals import PathReference
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.path.speed_reference import AHEAD_TICKS, SpeedReference

CRUISING = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)


def driven(pairs: list[tuple[float, float]], age_s: float = PERIOD_S) -> float:
    """The drift after paths with these (v, a)."""
    speed = SpeedReference()
    drift_mps = 0.0
    for v_mps, a_mps2 in pairs:
        path = CRUISING._replace(v_mps=v_mps, a_mps2=a_mps2)
        drift_mps = speed.drift_mps(path, age_s)
        speed.accept(path)
    return drift_mps


def test_a_speed_that_changes_with_its_acceleration_does_not_drift() -> None:
    assert driven([(20.0 - 3.0 * PERIOD_S * k, -3.0) for k in range(40)]) == pytest.approx(0.0)


def test_an_acceleration_that_begins_earlier_than_the_speed_changes_is_no_drift() -> None:
    ahead = [(20.0, -3.0 * k / AHEAD_TICKS) for k in range(AHEAD_TICKS)]
    braking = [(20.0 - 3.0 * PERIOD_S * k, -3.0) for k in range(40)]
    assert driven(ahead + braking) == pytest.approx(0.0)


def test_a_speed_that_stays_while_the_car_is_to_brake_drifts() -> None:
    n = 20
    expected = sum(3.0 * PERIOD_S * (1.0 - PERIOD_S / 2.0) ** k for k in range(n))
    assert driven([(20.0, -3.0)] * (n + 1)) == pytest.approx(expected)


def test_a_speed_that_rises_while_the_car_is_to_brake_drifts() -> None:
    assert driven([(20.0 + PERIOD_S * k, -0.5) for k in range(41)]) > 1.1


def test_a_speed_that_rises_without_an_acceleration_drifts() -> None:
    assert driven([(20.0 + PERIOD_S * k, 0.0) for k in range(81)]) > 1.2


def test_one_step_counts_like_a_fast_change() -> None:
    found = driven([(20.0, 0.2), (23.0, 0.2)], age_s=2.0 * PERIOD_S)
    assert found == pytest.approx(2.0 * PERIOD_S * 12.0)


@pytest.mark.parametrize(("ticks", "drift_mps"), [(24, 0.0), (25, 3.0 * PERIOD_S)])
def test_an_acceleration_explains_a_change_of_the_speed_within_0_6_s(
    ticks: int, drift_mps: float
) -> None:
    constant = [(20.0, 0.0)] * (ticks - 1)
    found = driven([(20.0, -3.0), *constant, (20.0 - 3.0 * PERIOD_S, 0.0)])
    assert found == pytest.approx(drift_mps)


@pytest.mark.parametrize("age_s", [0.0, -PERIOD_S])
def test_a_path_that_is_not_newer_leaves_the_drift(age_s: float) -> None:
    speed = SpeedReference()
    speed.accept(CRUISING)
    faster = CRUISING._replace(v_mps=20.1)
    drift_mps = speed.drift_mps(faster, PERIOD_S)
    assert drift_mps == pytest.approx(0.1)
    assert speed.drift_mps(faster, age_s) == drift_mps


def test_a_new_drive_clears_the_drift() -> None:
    speed = SpeedReference()
    for _ in range(40):
        path = CRUISING._replace(a_mps2=-3.0)
        speed.drift_mps(path, PERIOD_S)
        speed.accept(path)
    speed.begin()
    assert speed.drift_mps(CRUISING, PERIOD_S) == 0.0
