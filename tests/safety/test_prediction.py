"""Predictions of the car's motion, with and without a model, and states that repeat themselves."""

from math import nextafter, radians, tan

import numpy as np
import pytest
from kinematic_car import BRAKE_TO_SPEED, linear_model
from made_models import input_gains, join_gains, one_step, saturations
from made_residuals import predicted, residuals

from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, VehicleState
from rt_controller.model import roll_outs
from rt_controller.model.dynamics import Matrices
from rt_controller.safety.coast_model import StoppingCar
from rt_controller.safety.motion import STEPS, MotionPrediction

BRAKING = NEUTRAL_INPUT._replace(brake_n=40.0)


@pytest.fixture
def prediction():
    return MotionPrediction(linear_model(), 6)


def begin(prediction, speeds_mps, applied=NEUTRAL_INPUT):
    """Begin a roll-out at each of these speeds; after each of them, whether there are ten steps."""
    found = []
    for vx_mps in speeds_mps:
        prediction.begin(np.array([vx_mps, 0.0, 0.0, 0.0, 0.0, 0.0]))
        assert prediction.has_any
        prediction.advance(applied, 0.0)
        found.append(prediction.has_ten)
    return found


def advance(prediction, steps):
    for _ in range(steps):
        prediction.advance(NEUTRAL_INPUT, 0.0)


def test_there_are_ten_roll_outs_of_at_most_80_steps(prediction):
    assert not prediction.has_any
    assert begin(prediction, range(12), BRAKING) == [False] * 9 + [True] * 3
    braked = 40.0 * BRAKE_TO_SPEED
    assert prediction.newest()[0] == pytest.approx(11.0 + braked)
    assert prediction.oldest()[0] == pytest.approx(2.0 + STEPS * braked)
    advance(prediction, 78)
    assert not prediction.is_old
    advance(prediction, 1)
    assert prediction.is_old


def test_a_new_roll_out_replaces_the_oldest_one_before_it_is_advanced(prediction):
    begin(prediction, [20.0] * STEPS)
    prediction.begin(np.array([20.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert not prediction.has_ten  # the oldest one that is left has advanced nine steps


def test_a_missing_start_ends_the_row_of_ten(prediction):
    begin(prediction, [20.0] * STEPS)
    advance(prediction, 1)
    assert prediction.has_any
    assert not prediction.has_ten
    assert begin(prediction, [20.0]) == [False]


def test_falling_back_goes_on_with_the_oldest(prediction):
    begin(prediction, [20.0])
    prediction.fall_back()
    assert prediction.newest()[0] == 20.0
    begin(prediction, range(21, 20 + STEPS))
    prediction.fall_back()
    assert prediction.newest()[0] == 20.0
    assert prediction.has_any
    assert not prediction.has_ten
    assert not prediction.is_old
    advance(prediction, 80)
    assert prediction.is_old


def test_after_falling_back_the_roll_out_is_ten_steps_old(prediction):
    begin(prediction, range(10))
    prediction.fall_back()
    advance(prediction, 69)
    assert not prediction.is_old
    advance(prediction, 1)
    assert prediction.is_old
    assert begin(prediction, range(30, 40)) == [False] * 9 + [True]
    assert prediction.oldest()[0] == 30.0


def test_after_clearing_ten_new_roll_outs_are_begun(prediction):
    begin(prediction, [20.0] * 10)
    prediction.clear()
    assert not prediction.has_any
    assert begin(prediction, range(10)) == [False] * 9 + [True]
    assert prediction.oldest()[0] == 0.0


@pytest.mark.parametrize("rank", [0, 1, 2])
@pytest.mark.parametrize("drift", [0, 3])
@pytest.mark.parametrize("saturates", [False, True])
def test_a_step_is_that_of_the_contract(rank, drift, saturates):
    rng = np.random.default_rng(rank)
    n, m = 7, 3
    parts = [
        input_gains(
            rng.normal(size=(rank, n, m)),
            rng.normal(size=(rank, m, n)),
            rng.normal(size=(rank, m)),
            saturates,
        ),
        saturations(
            rng.normal(size=(n, drift)),
            rng.normal(size=(drift, n)),
            rng.normal(size=drift),
            m + 1 - np.arange(drift) % 2,
            one=m + 1,
        ),
    ]
    model = Matrices(
        rng.normal(size=(n, n)),
        rng.normal(size=(n, m)),
        rng.normal(size=(n, 1)),
        rng.normal(size=n),
        join_gains(*parts) if rank or drift else None,
    )
    prediction, psi = MotionPrediction(model, n), rng.normal(size=n)
    prediction.begin(psi)
    for applied in (ControlInput(0.3, 0.0, 0.1), ControlInput(0.0, 20.0, -0.2)):
        prediction.advance(applied, 0.004)
        psi = one_step(model, psi, np.array(applied), np.array([0.004]))
    assert prediction.newest() == pytest.approx(tuple(psi[:3]))


EXPECTED = ControlInput(0.2, 10.0, 0.1), 0.004
"""input and curvature of the next tick"""


@pytest.mark.parametrize(
    ("acted", "is_expected"),
    [
        (EXPECTED, True),
        *(((EXPECTED[0]._replace(steer_rad=rad), 0.004), False) for rad in (0.05, 0.15)),
        *(((EXPECTED[0], per_m), False) for per_m in (0.003, 0.005)),
    ],
)
def test_a_prepared_tick_has_the_same_predictions_and_computes_none_if_it_is_as_expected(
    acted, is_expected, monkeypatch
):
    steps = []

    class CountedStep(roll_outs.Step):
        def __call__(self, *arguments):
            steps.append(arguments)
            return super().__call__(*arguments)

    monkeypatch.setattr(roll_outs, "Step", CountedStep)
    rng = np.random.default_rng(0)
    shapes = ((6, 6), (6, 3), (6, 1), 6)
    model = Matrices(*(rng.normal(size=shape) for shape in shapes))
    prepared, other = (MotionPrediction(model, 6) for _ in range(2))
    prepared.prepare(*EXPECTED)
    assert not steps  # no roll-out has begun
    for psi in rng.normal(size=(3, 6)):
        for each in (prepared, other):
            each.begin(psi)
        prepared.prepare(*EXPECTED)
        steps.clear()
        prepared.advance(*acted)
        assert len(steps) == (not is_expected)
        other.advance(*acted)
        assert prepared.newest() == other.newest()
        prepared.prepare(*acted)  # what begins now is not in it
    prepared.advance(*acted)
    other.advance(*acted)
    assert prepared.newest() == other.newest()


def test_v_x_v_y_and_yaw_rate_are_returned_in_this_order(prediction):
    for _ in range(10):
        prediction.begin(np.array([20.0, 0.3, 0.1, 0.0, 0.0, 0.0]))
        prediction.advance(NEUTRAL_INPUT._replace(steer_rad=0.5), 0.0)
    assert prediction.newest() == pytest.approx((20.0, 0.3, 0.15))
    assert prediction.oldest() == pytest.approx((20.0, 0.3, 0.15))


CRUISING = VehicleState(20.0, 0.0, 0.0, 0.5, 0.0, 0.0)
Q = Quantity


def frozen_ticks(found, values, state):
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
def test_a_repeated_state_that_must_change_is_counted(state, expected):
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
        (ControlInput(0.1, 10.0, radians(3.0)), False),  # exactly
    ],
)
def test_a_repeated_state_of_a_car_whose_actuators_have_moved_is_counted(change, is_counted):
    found, values = residuals()
    before = ControlInput(0.1, 10.0, radians(3.0))
    after = ControlInput(*(a + b for a, b in zip(before, change, strict=True)))
    ticks = []
    for feedback in (before, before, after, None, after, before):
        found.compare(CRUISING, CRUISING, CRUISING, 0.0, 1, feedback)
        ticks.append(values[Q.FROZEN_TICKS])
    assert ticks == ([0, 0, 1, 0, 1, 0] if is_counted else [0] * 6)


@pytest.mark.parametrize(
    "state", [CRUISING._replace(vy_mps=0.04), CRUISING._replace(yaw_rate_radps=0.004)]
)
def test_the_error_of_rounded_signals_does_not_make_a_steady_car_move(state):
    """The model may expect any change: it knows neither grade nor wind."""
    found, values = residuals(predicted((25.0, 0.0, 0.1), *[(20.0, 0.0, 0.0)] * 9))
    for _ in range(400):
        found.compare(state, state, state, 0.0, 1)
        assert values[Q.FROZEN_TICKS] == 0


def changing(tick):
    return VehicleState(20.0 + 0.01 * tick, 0.01 * tick, 0.01 * tick, 0.5, 0.0, 0.0)


def received(states):
    found, _ = residuals()
    for state in states:
        found.compare(CRUISING, CRUISING, state, 0.0, 1)
    return found


@pytest.mark.parametrize(("ticks_between", "is_repeated"), [(0, True), (36, True), (37, False)])
def test_two_states_in_a_row_of_the_last_second_are_repeated(ticks_between, is_repeated):
    others = [changing(100 + tick) for tick in range(ticks_between)]
    found = received([changing(0), changing(1), *others, changing(0), changing(1)])
    assert found.is_repeated is is_repeated
    found.begin(CRUISING)
    assert not found.is_repeated


@pytest.mark.parametrize("ticks", [[], [0], [0, 1], [0, 2, 0, 1], [1, 0, 0, 1]])
def test_states_that_were_not_two_in_a_row_are_not_repeated(ticks):
    assert not received(map(changing, ticks)).is_repeated


@pytest.mark.parametrize(("signals", "is_repeated"), [(2, False), (3, True), (4, True)])
def test_an_almost_constant_state_is_not_repeated(signals, is_repeated):
    for change in (-1.0, 1.0):
        changes = [change * (k < signals) for k in range(6)]
        other = VehicleState(*(value + by for value, by in zip(CRUISING, changes, strict=True)))
        assert received([CRUISING, other, CRUISING, other]).is_repeated is is_repeated


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_car_brakes_and_rolls_along_the_circle_of_its_wheels(side):
    vx, vy, yaw_rate = StoppingCar().motion(10.0, ControlInput(0.0, 80.0, side * 0.37))
    assert vx == pytest.approx(10.0 - 0.05 * 80.0 * 0.025)
    assert yaw_rate == pytest.approx(side * 9.9 * tan(0.02) / 2.91)
    assert vy == pytest.approx(1.8604 * yaw_rate)


def test_a_stopping_car_stands_still_in_the_end():
    assert StoppingCar().motion(0.05, ControlInput(0.0, 80.0, 0.3)) == (0.0, 0.0, 0.0)
    assert (StoppingCar().modelled_mps, StoppingCar().throttle_mps2) == (7.0, 6.0)
