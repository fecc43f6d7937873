"""States that are frozen, and states of before that arrive again."""

from math import nextafter

import pytest
from made_residuals import predicted, residuals

from rt_controller.contract.signals import ControlInput, VehicleState
from rt_controller.safety.checks import Quantity
from rt_controller.safety.motion import Residuals

CRUISING = VehicleState(20.0, 0.0, 0.0, 0.5, 0.0, 0.0)
Q = Quantity


def frozen_ticks(found: Residuals, values: list[float], state: VehicleState) -> list[float]:
    """Value of the check in 4 ticks in which this state arrives."""
    ticks = []
    for _ in range(4):
        values[Q.FROZEN_TICKS] = 0.0
        found.compare(state, state, state, 0.0, 1)
        ticks.append(values[Q.FROZEN_TICKS])
    return ticks


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        (CRUISING, [0, 0, 0, 0]),
        # e_y changes by 5.5 mm in a period, by 4.5 mm, and in both directions
        (CRUISING._replace(vy_mps=0.22), [0, 1, 2, 3]),
        (CRUISING._replace(vy_mps=0.18), [0, 0, 1, 2]),
        (CRUISING._replace(vy_mps=-0.22), [0, 1, 2, 3]),
        # e_psi changes by 0.9 mrad in a period, and by 0.5
        (CRUISING._replace(yaw_rate_radps=0.036), [0, 1, 2, 3]),
        (CRUISING._replace(yaw_rate_radps=0.02), [0, 0, 1, 2]),
        (CRUISING._replace(yaw_rate_radps=-0.036), [0, 1, 2, 3]),
        # at the limits of 5 mm and 0.8 mrad
        (CRUISING._replace(vy_mps=nextafter(0.2, 0.0)), [0, 0, 1, 2]),
        (CRUISING._replace(yaw_rate_radps=0.032), [0, 0, 1, 2]),
        # at 1 m/s the car is driven, below it may stand
        (VehicleState(1.0, 0.22, 0.0, 0.025, 0.0, 0.0), [0, 1, 2, 3]),
        (VehicleState(0.99, 0.22, 0.0, 0.025, 0.0, 0.0), [0, 0, 0, 0]),
    ],
)
def test_a_repeated_state_that_must_change_is_counted(
    state: VehicleState, expected: list[int]
) -> None:
    found, values = residuals()
    assert frozen_ticks(found, values, state) == expected
    other = state._replace(ey_m=1.0)
    assert frozen_ticks(found, values, other) == expected
    found.begin(state)
    assert frozen_ticks(found, values, state) == expected


@pytest.mark.parametrize(
    ("change", "is_counted"),
    [
        (ControlInput(0.101, 0.0, 0.0), True),
        (ControlInput(0.0, -10.1, 0.0), True),
        (ControlInput(0.0, 0.0, 0.053), True),
        (ControlInput(0.099, 9.9, -0.052), False),
    ],
)
def test_a_repeated_state_of_a_car_whose_actuators_have_moved_is_counted(
    change: ControlInput, is_counted: bool
) -> None:
    found, values = residuals()
    before = ControlInput(0.3, 20.0, 0.1)
    after = ControlInput(*(a + b for a, b in zip(before, change, strict=True)))
    ticks = []
    for feedback in (before, before, after, None, after, before):
        found.compare(CRUISING, CRUISING, CRUISING, 0.0, 1, feedback)
        ticks.append(values[Q.FROZEN_TICKS])
    assert ticks == ([0, 0, 1, 0, 1, 0] if is_counted else [0] * 6)


@pytest.mark.parametrize(
    "state", [CRUISING._replace(vy_mps=0.03), CRUISING._replace(yaw_rate_radps=0.003)]
)
def test_the_error_of_rounded_signals_does_not_make_a_steady_car_move(state: VehicleState) -> None:
    """The model may expect any change: it knows neither grade nor wind."""
    found, values = residuals(predicted((25.0, 0.0, 0.1), *[(20.0, 0.0, 0.0)] * 9))
    for _ in range(400):
        found.compare(state, state, state, 0.0, 1)
        assert values[Q.FROZEN_TICKS] == 0


def changing(tick: int) -> VehicleState:
    return VehicleState(20.0 + 0.01 * tick, 0.01 * tick, 0.01 * tick, 0.5, 0.0, 0.0)


def received(states: list[VehicleState]) -> Residuals:
    found, _ = residuals()
    for state in states:
        found.compare(CRUISING, CRUISING, state, 0.0, 1)
    return found


@pytest.mark.parametrize(("ticks_between", "is_repeated"), [(0, True), (36, True), (37, False)])
def test_two_states_in_a_row_of_the_last_second_are_repeated(
    ticks_between: int, is_repeated: bool
) -> None:
    others = [changing(100 + tick) for tick in range(ticks_between)]
    found = received([changing(0), changing(1), *others, changing(0), changing(1)])
    assert found.is_repeated is is_repeated
    found.begin(CRUISING)
    assert not found.is_repeated


def test_states_that_were_not_two_in_a_row_are_not_repeated() -> None:
    assert not received([]).is_repeated
    assert not received([changing(0)]).is_repeated
    assert not received([changing(0), changing(1)]).is_repeated
    assert not received([changing(0), changing(2), changing(0), changing(1)]).is_repeated
    assert not received([changing(1), changing(0), changing(0), changing(1)]).is_repeated


@pytest.mark.parametrize(("signals", "is_repeated"), [(2, False), (3, True), (4, True)])
def test_an_almost_constant_state_is_not_repeated(signals: int, is_repeated: bool) -> None:
    for change in (-1.0, 1.0):
        changes = [change * (k < signals) for k in range(6)]
        other = VehicleState(*(value + by for value, by in zip(CRUISING, changes, strict=True)))
        assert received([CRUISING, other, CRUISING, other]).is_repeated is is_repeated
