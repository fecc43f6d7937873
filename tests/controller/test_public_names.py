"""The public names: light to import, and a controller that plans like the program."""

import subprocess
import sys

import numpy as np
import pytest

import rt_controller
from rt_controller import Bundle, Controller, MpcSettings, PathReference, VehicleState
from rt_controller.config import ControllerConfig
from rt_controller.contract.artifact import load_bundle, shipped_model
from rt_controller.contract.errors import ArtifactError
from rt_controller.control.solver import SolveStatus

STATE = VehicleState(20.0, 0.0, 0.0, 0.5, 0.3, 0.0)
LANE = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)


@pytest.fixture(params=["lti", "mdk-net"])
def controller(request: pytest.FixtureRequest) -> Controller:
    return Controller.load(request.param)


def test_the_package_imports_nothing_heavy() -> None:
    program = (
        "import sys, rt_controller\n"
        "sys.exit(bool({'numpy', 'can', 'onnxruntime', 'pydantic'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_every_public_name_can_be_imported() -> None:
    assert all(getattr(rt_controller, name) is not None for name in dir(rt_controller))
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        _ = rt_controller.Nothing


def test_a_plan_has_inputs_and_predicted_states_over_the_horizon(controller: Controller) -> None:
    plan = controller.step(STATE, LANE, 0.0)
    assert plan.is_solved
    assert plan.inputs.shape == (20, 3)
    assert plan.states.shape == (21, 6)
    np.testing.assert_array_equal(plan.states[0], STATE)
    assert plan.time_s[-1] == pytest.approx(0.5)


def test_a_car_left_of_its_lane_is_steered_to_the_right(controller: Controller) -> None:
    plan = controller.step(STATE, LANE, 0.0)
    assert plan.control.steer_rad < 0.0
    assert plan.states[-1, 4] < STATE.ey_m


def test_the_model_brought_back_to_its_lane_stays_there(controller: Controller) -> None:
    state = STATE
    for _ in range(120):
        plan = controller.step(state, LANE, 0.0)
        state = VehicleState(*plan.states[1].tolist())
    assert abs(state.ey_m) < 0.05


def test_a_reset_controller_plans_as_a_new_one(controller: Controller) -> None:
    first = controller.step(STATE, LANE, 0.0)
    controller.step(STATE._replace(ey_m=-0.5), LANE, 0.001)
    controller.reset()
    np.testing.assert_allclose(controller.step(STATE, LANE, 0.0).inputs, first.inputs, atol=1e-9)


def test_a_state_that_is_no_number_gives_no_plan(controller: Controller) -> None:
    plan = controller.step(STATE._replace(vy_mps=float("nan")), LANE, 0.0)
    assert plan.status is not SolveStatus.SOLVED
    assert not plan.is_solved
    assert np.isnan(plan.inputs).all()
    assert np.isnan(plan.states).all()
    assert controller.step(STATE, LANE, 0.0).is_solved


def test_arrays_are_taken_and_other_lengths_refused(controller: Controller) -> None:
    first = controller.step(STATE, LANE, 0.0)
    controller.reset()
    again = controller.step(np.array(STATE), list(LANE), 0.0)  # type: ignore[arg-type]
    np.testing.assert_allclose(again.inputs, first.inputs, atol=1e-6)
    with pytest.raises(TypeError, match="epsi_rad"):
        controller.step(STATE[:5], LANE, 0.0)  # type: ignore[arg-type]
    assert controller.step(STATE, LANE, 0.0).is_solved


@pytest.mark.parametrize("A", [np.full((6, 6), np.nan), np.eye(5), np.eye(6) * 1j])
def test_a_linear_model_of_other_matrices_is_refused(A: np.ndarray) -> None:
    with pytest.raises(ArtifactError, match=r"^A: expected"):
        Bundle.linear(A, np.zeros((6, 3)), np.zeros((6, 1)))


def test_a_controller_takes_a_bundle_and_settings() -> None:
    bundle = load_bundle(shipped_model("lti"))
    config = ControllerConfig(mpc=MpcSettings(horizon=8))
    plan = Controller.load(bundle, config).step(STATE, LANE, 0.0)
    assert plan.inputs.shape == (8, 3)
