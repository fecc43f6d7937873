"""Actuators that do not do what they are commanded to do."""

import pytest

from rt_controller.contract.signals import ControlInput
from sim_bridge.failed_actuators import FAILED_TICKS, Actuator, FailedActuators

COASTING = ControlInput(0.0, 0.0, 0.0)


def after(pairs: list[tuple[ControlInput, ControlInput]]) -> bool:
    """Whether they are failed after these periods of (commanded, applied)."""
    actuators = FailedActuators()
    for commanded, applied in pairs:
        actuators.note(commanded, applied)
    return bool(actuators.failed)


def test_a_wheel_that_does_not_move_has_failed_after_100_ms() -> None:
    stuck = [(COASTING._replace(steer_rad=0.1 + 0.03 * k), COASTING) for k in range(6)]
    assert not after(stuck[: FAILED_TICKS - 1])
    assert after(stuck[:FAILED_TICKS])
    assert not after([*stuck[:2], (COASTING, COASTING), *stuck[2:4]])


def test_a_wheel_that_is_late_but_moves_has_not_failed() -> None:
    late = [
        (COASTING._replace(steer_rad=0.05 * k), COASTING._replace(steer_rad=0.05 * (k - 2)))
        for k in range(20)
    ]
    assert not after(late)


@pytest.mark.parametrize(("open_by", "is_failed"), [(1.0, True), (0.04, False), (-0.5, False)])
def test_a_throttle_that_stays_open_has_failed(open_by: float, is_failed: bool) -> None:
    commanded = COASTING._replace(throttle=0.5)
    applied = COASTING._replace(throttle=0.5 + open_by)
    assert after([(commanded, applied)] * FAILED_TICKS) == is_failed


def test_what_has_failed_stays_failed() -> None:
    stuck = (COASTING._replace(steer_rad=0.1), COASTING)
    assert after([stuck] * FAILED_TICKS + [(COASTING, COASTING)] * 10)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("angle_rad", "error_rad", "moved_rad", "is_failed"),
    [
        (0.0, 0.031, 0.0, True),
        (0.0, 0.029, 0.0, False),
        (0.2, 0.031, 0.0, True),
        (0.2, -0.031, 0.0, True),
        (0.2, -0.029, 0.0, False),
        (0.2, 0.04, 0.0009, True),
        (0.2, 0.04, -0.0009, True),
        (0.2, 0.04, 0.0011, False),
        (0.2, 0.04, -0.0011, False),
    ],
)
def test_a_wheel_is_stuck_where_it_is_if_it_does_not_move_and_is_off(
    side: float, angle_rad: float, error_rad: float, moved_rad: float, is_failed: bool
) -> None:
    angles = [side * (angle_rad + k * moved_rad) for k in range(6)]
    pairs = [
        (COASTING._replace(steer_rad=each + side * error_rad), COASTING._replace(steer_rad=each))
        for each in angles
    ]
    there = COASTING._replace(steer_rad=angles[0])
    assert after([(there, there), *pairs[1:]]) is is_failed


@pytest.mark.parametrize(("change_rad", "is_failed"), [(0.0, False), (0.019, False), (0.021, True)])
def test_a_wheel_with_an_offset_is_not_stuck_while_the_command_is_constant(
    change_rad: float, is_failed: bool
) -> None:
    applied = COASTING._replace(steer_rad=0.2)
    offset = (COASTING._replace(steer_rad=0.3), applied)
    later = (COASTING._replace(steer_rad=0.3 + change_rad), applied)
    assert after([offset] * 10 + [later] * FAILED_TICKS) is is_failed


@pytest.mark.parametrize(("open_by", "is_open"), [(0.051, True), (0.049, False)])
@pytest.mark.parametrize(("ticks", "is_long"), [(3, False), (4, True)])
def test_a_throttle_is_open_after_100_ms(
    open_by: float, is_open: bool, ticks: int, is_long: bool
) -> None:
    pair = (COASTING._replace(throttle=0.3), COASTING._replace(throttle=0.3 + open_by))
    closed = (COASTING, COASTING)
    assert after([pair] * 3 + [closed] + [pair] * ticks) is (is_open and is_long)


def test_a_throttle_and_a_wheel_are_counted_apart() -> None:
    open_throttle = (COASTING, COASTING._replace(throttle=0.2))
    stuck = (COASTING._replace(steer_rad=0.1), COASTING)
    assert not after([open_throttle, open_throttle, open_throttle, stuck, stuck, stuck])


@pytest.mark.parametrize(("ticks", "is_failed"), [(3, False), (4, True)])
def test_a_wheel_that_followed_for_a_tick_is_counted_anew(ticks: int, is_failed: bool) -> None:
    stuck = (COASTING._replace(steer_rad=0.1), COASTING)
    assert after([stuck] * 3 + [(COASTING, COASTING)] + [stuck] * ticks) is is_failed


def test_each_failed_actuator_is_named_in_the_order_of_detection() -> None:
    actuators = FailedActuators()
    open_throttle = COASTING._replace(throttle=0.2)
    for _ in range(FAILED_TICKS):
        actuators.note(COASTING, open_throttle)
    assert actuators.failed == [Actuator.THROTTLE]
    for _ in range(2 * FAILED_TICKS):
        actuators.note(COASTING._replace(steer_rad=0.1), open_throttle)
    assert actuators.failed == [Actuator.THROTTLE, Actuator.STEERING_WHEEL]
    wheel = FailedActuators()
    for _ in range(FAILED_TICKS):
        wheel.note(COASTING._replace(steer_rad=0.1), COASTING)
    assert wheel.failed == [Actuator.STEERING_WHEEL]


def test_at_its_limits_no_actuator_has_failed() -> None:
    open_throttle = (COASTING, COASTING._replace(throttle=0.05))
    assert not after([open_throttle] * 6)
    off = (COASTING._replace(steer_rad=0.03), COASTING)
    assert not after([off] * 6)
    offset = COASTING._replace(steer_rad=-0.05)
    assert not after([(COASTING, offset)] + [(COASTING._replace(steer_rad=0.02), offset)] * 6)
    commanded = COASTING._replace(steer_rad=0.5)
    moving = [(commanded, COASTING._replace(steer_rad=1e-3 * (k % 2))) for k in range(1, 8)]
    assert not after(moving)
