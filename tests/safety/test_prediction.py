"""Open-loop roll-outs of the model that were begun in the last ten ticks."""

import numpy as np
import pytest
from kinematic_car import BRAKE_TO_SPEED, linear_model
from made_models import input_gains, join_gains, one_step, saturations

from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from rt_controller.model.dynamics import Matrices
from rt_controller.safety.motion import STEPS, MotionPrediction

BRAKING = NEUTRAL_INPUT._replace(brake_n=40.0)


@pytest.fixture
def prediction() -> MotionPrediction:
    return MotionPrediction(linear_model(), 6)


def begin(prediction: MotionPrediction, vx_mps: float) -> None:
    prediction.begin(np.array([vx_mps, 0.0, 0.0, 0.0, 0.0, 0.0]))


def test_one_and_ten_steps_are_those_of_the_model(prediction: MotionPrediction) -> None:
    assert not prediction.has_any
    for k in range(STEPS):
        begin(prediction, 20.0 + k)
        prediction.advance(BRAKING, 0.0)
        assert prediction.has_ten == (k == STEPS - 1)
    braked = 40.0 * BRAKE_TO_SPEED
    assert prediction.newest()[0] == pytest.approx(20.0 + STEPS - 1 + braked)
    assert prediction.oldest()[0] == pytest.approx(20.0 + STEPS * braked)
    begin(prediction, 20.0)
    assert not prediction.has_ten  # the oldest one that is left has advanced nine steps


@pytest.mark.parametrize("rank", [0, 1, 2])
@pytest.mark.parametrize("drift", [0, 3])
@pytest.mark.parametrize("saturates", [False, True])
def test_a_step_is_that_of_the_contract(rank: int, drift: int, saturates: bool) -> None:
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


def test_a_missing_start_ends_the_row_of_ten(prediction: MotionPrediction) -> None:
    for _ in range(STEPS):
        begin(prediction, 20.0)
        prediction.advance(NEUTRAL_INPUT, 0.0)
    prediction.advance(NEUTRAL_INPUT, 0.0)
    assert prediction.has_any
    assert not prediction.has_ten
    begin(prediction, 20.0)
    prediction.advance(NEUTRAL_INPUT, 0.0)
    assert not prediction.has_ten


def test_after_clearing_there_is_none(prediction: MotionPrediction) -> None:
    begin(prediction, 20.0)
    prediction.clear()
    assert not prediction.has_any


def test_falling_back_goes_on_with_the_oldest(prediction: MotionPrediction) -> None:
    begin(prediction, 20.0)
    prediction.advance(NEUTRAL_INPUT, 0.0)
    prediction.fall_back()
    assert prediction.newest()[0] == 20.0
    for k in range(1, STEPS):
        begin(prediction, 20.0 + k)
        prediction.advance(NEUTRAL_INPUT, 0.0)
    prediction.fall_back()
    assert prediction.newest()[0] == 20.0
    assert prediction.has_any
    assert not prediction.has_ten
    assert not prediction.is_old
    for _ in range(80):
        prediction.advance(NEUTRAL_INPUT, 0.0)
    assert prediction.is_old


def test_there_are_ten_roll_outs_of_at_most_80_steps(prediction: MotionPrediction) -> None:
    for k in range(12):
        begin(prediction, float(k))
        prediction.advance(NEUTRAL_INPUT, 0.0)
        assert prediction.has_ten == (k >= 9)
    assert prediction.newest()[0] == 11.0
    assert prediction.oldest()[0] == 2.0
    for _ in range(78):
        prediction.advance(NEUTRAL_INPUT, 0.0)
    assert not prediction.is_old
    prediction.advance(NEUTRAL_INPUT, 0.0)
    assert prediction.is_old


def test_after_falling_back_the_roll_out_is_ten_steps_old(prediction: MotionPrediction) -> None:
    for k in range(10):
        begin(prediction, float(k))
        prediction.advance(NEUTRAL_INPUT, 0.0)
    prediction.fall_back()
    for _ in range(69):
        prediction.advance(NEUTRAL_INPUT, 0.0)
    assert not prediction.is_old
    prediction.advance(NEUTRAL_INPUT, 0.0)
    assert prediction.is_old
    for k in range(10):
        begin(prediction, 30.0 + k)
        prediction.advance(NEUTRAL_INPUT, 0.0)
        assert prediction.has_ten == (k == 9)
    assert prediction.oldest()[0] == 30.0


def test_after_clearing_ten_new_roll_outs_are_begun(prediction: MotionPrediction) -> None:
    for _ in range(10):
        begin(prediction, 20.0)
        prediction.advance(NEUTRAL_INPUT, 0.0)
    prediction.clear()
    for k in range(10):
        assert not prediction.has_ten
        begin(prediction, float(k))
        assert prediction.has_any
        prediction.advance(NEUTRAL_INPUT, 0.0)
    assert prediction.has_ten
    assert prediction.oldest()[0] == 0.0


def test_v_x_v_y_and_yaw_rate_are_returned_in_this_order(prediction: MotionPrediction) -> None:
    for _ in range(10):
        prediction.begin(np.array([20.0, 0.3, 0.1, 0.0, 0.0, 0.0]))
        prediction.advance(NEUTRAL_INPUT._replace(steer_rad=0.5), 0.0)
    assert prediction.newest() == pytest.approx((20.0, 0.3, 0.15))
    assert prediction.oldest() == pytest.approx((20.0, 0.3, 0.15))
