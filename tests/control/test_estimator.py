"""A constant disturbance of the car is estimated, and the car driven onto its path against it."""

import numpy as np
import pytest
from made_models import make_bundle, one_step

from rt_controller.config import MpcSettings
from rt_controller.contract.signals import ControlInput, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control import estimator as estimator_module
from rt_controller.control.estimator import KEPT, STEPS, DisturbanceResponse, Estimator
from rt_controller.control.mpc import Mpc
from rt_controller.control.program import SolveStatus
from rt_controller.model.bundle import Bundle
from rt_controller.model.lift import Lift

LINEAR = make_bundle(Lift(), latents=0)
DISTURBANCE = np.array(VehicleState(0.0005, -0.01, 0.004, 0.0, 0.003, 0.001))
START = VehicleState(20.0, 0.0, 0.0, 0.5, 0.0, 0.0)
OBSERVED = [0, 1, 2, 4, 5]


def kinematic_car():
    """Turns with the steering wheel; lateral motion fades, place and heading integrate."""
    A, B = np.diag(KEPT), np.zeros((6, 3))
    A[5, 2] = A[4, 1] = PERIOD_S
    A[4, 5] = PERIOD_S * START.vx_mps
    A[3, 0] = PERIOD_S
    B[2, 2] = 0.05
    return Bundle.linear(A, B, np.zeros((6, 1)))


CAR = kinematic_car()


def after(bundle, state, u):
    """The next state of a car that is the model, with the disturbance."""
    following = one_step(bundle, np.array(state), np.array(u), np.zeros(1))
    return VehicleState(*(following + DISTURBANCE).tolist())


@pytest.fixture
def unfiltered(monkeypatch):
    """The model that is driven has no kinematics of a car: its states are taken as measured."""
    monkeypatch.setattr(estimator_module, "GAIN", VehicleState(*[1.0] * 6))


def estimated(periods, missing=None):
    """The estimator after so many periods of changing inputs."""
    rng, estimator, state = np.random.default_rng(0), Estimator(CAR, 40), START
    for period in range(periods):
        if period == missing:
            estimator.forget()
        psi = np.array(estimator.estimate(state, 0.0))
        u = ControlInput(rng.uniform(0.0, 0.3), 0.0, 0.05 * rng.normal())
        estimator.advance(psi, u, 0.0)
        state = after(CAR, state, u)
    return estimator


def test_the_response_to_a_disturbance_is_that_of_the_kinematics():
    response, deviation = DisturbanceResponse(30), np.zeros(6)
    for k in range(31):
        found = response.at(k, DISTURBANCE, START.vx_mps)[OBSERVED]
        np.testing.assert_allclose(found, deviation[OBSERVED], rtol=1e-12, atol=1e-15)
        if k:
            cause = response.cause(k, deviation, START.vx_mps)
            np.testing.assert_allclose(cause[OBSERVED], DISTURBANCE[OBSERVED], rtol=1e-9)
        deviation = CAR.A @ deviation + DISTURBANCE


@pytest.mark.usefixtures("unfiltered")
def test_the_estimate_converges_and_outlasts_a_missing_period_but_not_the_drive():
    estimator = estimated(450, missing=445)
    np.testing.assert_allclose(
        estimator.disturbance[OBSERVED], DISTURBANCE[OBSERVED], rtol=0.02, atol=2e-5
    )
    estimator.reset()
    assert not estimator.disturbance.any()


def test_no_roll_out_is_compared_across_a_missing_period():
    assert not estimated(STEPS + 5, missing=STEPS // 2 + 5).disturbance.any()
    assert estimated(STEPS + 5).disturbance.any()


def offset_m(under_way, *, is_estimated):
    """e_y of the disturbed car at the end of a straight drive, whose inputs act with a delay."""
    settings = MpcSettings()
    mpc = Mpc(LINEAR, settings.horizon, settings.cost(), knots=settings.knots)
    path = PathReference(0.0, 0.0, 0.0, 0.0, START.vx_mps, 0.0)
    previous = ControlInput(0.1, 0.0, 0.0)
    state, sent, applied = START, [previous] * under_way, previous
    for _ in range(800):
        x_0 = mpc.observer.observe(state, applied)
        if not is_estimated:
            mpc.reset()
            x_0 = state
        assert mpc.plan(x_0, 0.0, path, previous, None, tuple(sent)) is SolveStatus.SOLVED
        previous = ControlInput(*mpc.inputs[0].tolist())
        sent.append(previous)
        mpc.prepare()
        applied = sent.pop(0)
        state = after(LINEAR, state, applied)
        state = state._replace(ds_m=state.vx_mps * PERIOD_S)  # of the model it would grow
    return abs(state.ey_m)


def test_the_lateral_offset_of_a_disturbed_car_is_reduced():
    for under_way in (0, 2):
        without_m = offset_m(under_way, is_estimated=False)
        assert offset_m(under_way, is_estimated=True) < min(0.6 * without_m, 0.02)


def test_the_first_state_and_that_after_a_missing_period_are_the_measured_ones():
    estimator = Estimator(LINEAR, 40)
    assert estimator.estimate(START, 0.0) == START
    estimator.advance(np.array(START), ControlInput(0.1, 0.0, 0.0), 0.0)
    measured = START._replace(ey_m=0.2)
    assert abs(estimator.estimate(measured, 0.0).ey_m) < 0.05
    estimator.forget()
    assert estimator.estimate(measured, 0.0) == measured


def test_the_noise_of_the_lateral_place_is_averaged():
    rng, estimator, errors_m = np.random.default_rng(3), Estimator(LINEAR, 40), []
    for _ in range(400):
        noise_m = 0.02 * rng.normal()
        estimate = estimator.estimate(START._replace(ey_m=noise_m), 0.0)
        estimator.advance(np.array(estimate), ControlInput(0.1, 0.0, 0.0), 0.0)
        errors_m.append(estimate.ey_m)
    assert np.std(errors_m[100:]) < 0.5 * 0.02
