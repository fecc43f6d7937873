"""The public names: light to import, and a controller that plans like the program."""

import math
import pydoc
import re
import subprocess
import sys
from importlib.metadata import version
from typing import Any

import numpy as np
import pytest

import rt_controller
from rt_controller import (
    Bundle,
    ControlInput,
    Controller,
    CurvaturePreview,
    MpcSettings,
    PathReference,
    VehicleState,
    fit_preview,
)
from rt_controller.config import ControllerConfig
from rt_controller.contract.errors import ArtifactError
from rt_controller.control.program import SolveStatus
from rt_controller.model.artifact import load_bundle, shipped_model

STATE = VehicleState(20.0, 0.0, 0.0, 0.5, 0.3, 0.0)
LANE = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)


@pytest.fixture(params=["lti", "mdk-net"])
def controller(request: pytest.FixtureRequest) -> Controller:
    return Controller.load(request.param)


@pytest.fixture
def another(request: pytest.FixtureRequest) -> Controller:
    """A second controller with the model of `controller`."""
    return Controller.load(request.node.callspec.params["controller"])


def test_the_package_imports_nothing_heavy() -> None:
    program = (
        "import sys, rt_controller\n"
        "sys.exit(bool({'numpy', 'can', 'onnxruntime', 'pydantic'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_every_public_name_can_be_imported() -> None:
    assert all(getattr(rt_controller, name) is not None for name in dir(rt_controller))
    assert set(rt_controller.__all__) < set(dir(rt_controller))
    assert rt_controller.__version__ == version("rt-controller")
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        _ = rt_controller.Nothing


def test_help_describes_every_public_name() -> None:
    shown = pydoc.plain(pydoc.render_doc(rt_controller))
    lines = shown.split("DESCRIPTION")[1].split("Each is imported")[0].splitlines()
    first_columns = ", ".join(re.split(r"\s{2,}", line.strip())[0] for line in lines)
    assert set(rt_controller.__all__) <= set(first_columns.split(", "))
    assert "class Controller(builtins.object)" in shown


def test_a_plan_has_inputs_and_predicted_states_over_the_horizon(controller: Controller) -> None:
    plan = controller.step(STATE, LANE, 0.0)
    assert plan.is_solved
    horizon = {"mdk-net": 40, "lti": 20}[controller.bundle.name]
    assert plan.inputs.shape == (horizon, 3)
    assert plan.states.shape == (horizon + 1, 6)
    np.testing.assert_array_equal(plan.states[0], STATE)
    assert plan.time_s[-1] == pytest.approx(horizon * 0.025)


def test_a_car_left_of_its_lane_is_steered_to_the_right(controller: Controller) -> None:
    plan = controller.step(STATE, LANE, 0.0)
    assert plan.control.steer_rad < 0.0
    assert plan.states[-1, 4] < STATE.ey_m


def test_the_model_brought_back_to_its_lane_stays_there(controller: Controller) -> None:
    state = STATE
    # Predicted again and again, the progress of lti grows.
    for _ in range({"mdk-net": 400, "lti": 120}[controller.bundle.name]):
        plan = controller.step(state, LANE, 0.0)
        state = VehicleState(*plan.states[1].tolist())
    assert abs(state.ey_m) < 0.05


def test_a_reset_controller_plans_as_a_new_one(controller: Controller) -> None:
    first = controller.step(STATE, LANE, 0.0)
    controller.step(STATE._replace(ey_m=-0.5), LANE, 0.001)
    controller.reset()
    again = controller.step(STATE, LANE, 0.0).inputs
    np.testing.assert_allclose(again, first.inputs, atol=1e-6)  # the solver's accuracy


def test_a_problem_without_a_solution_gives_no_plan(
    controller: Controller, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as broken:
        broken.setattr(controller._mpc, "plan", lambda *_: SolveStatus.INFEASIBLE)
        broken.setattr(controller._mpc, "predicted_states", lambda: None)
        plan = controller.step(STATE, LANE, 0.0)
    assert not plan.is_solved
    assert np.isnan(plan.inputs).all()
    assert np.isnan(plan.states).all()
    assert controller.step(STATE, LANE, 0.0).is_solved


FLAT = CurvaturePreview(3.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NAN = math.nan


@pytest.mark.parametrize(
    ("arguments", "error", "expected"),
    [
        ((STATE._replace(vx_mps=NAN), LANE, 0.0), ValueError, "state.vx_mps: expected -20 to 100"),
        ((STATE._replace(epsi_rad=90.0), LANE, 0.0), ValueError, "state.epsi_rad: .* found 90"),
        ((STATE._replace(ey_m=-100.0), LANE, 0.0), ValueError, "state.ey_m: expected -30 to 30"),
        ((STATE, LANE._replace(v_mps=120.0), 0.0), ValueError, "path.v_mps: expected 0 to 100, f"),
        ((STATE, LANE._replace(c1=NAN), 0.0), ValueError, "path.c1: expected -0.6 to 0.6, found n"),
        ((STATE, LANE, 5.0), ValueError, "curvature_per_m: .* at most 0.16 1/m, found 5"),
        ((STATE, LANE, NAN), ValueError, "curvature_per_m: expected .*, found nan"),
        ((STATE, LANE, FLAT._replace(spacing_m=0.0)), ValueError, ".* 0.05 to 65.5 m.*, found 0 "),
        ((STATE, LANE, FLAT._replace(spacing_m=NAN)), ValueError, ".* 0.05 to 65.5 m.*found nan "),
        ((STATE, LANE, FLAT._replace(k1_per_m=-0.2)), ValueError, ".* at most 0.16.*found -0.2 "),
        ((STATE, LANE, FLAT._replace(k4_per_m=math.inf)), ValueError, ".* at most 0.16.*found inf"),
        ((STATE, LANE, 0.0, ControlInput(NAN, 0.0, 0.0)), ValueError, "applied: expected finite"),
        ((STATE[:5], LANE, 0.0), TypeError, r"state: expected 6 numbers \(vx_mps, .* found \(20"),
        ((np.zeros((1, 6)), LANE, 0.0), TypeError, "state: expected 6 numbers"),
        ((LANE, STATE, 0.0), TypeError, "state: expected 6 numbers .* found PathReference"),
        ((STATE, None, 0.0), TypeError, "path: expected 6 numbers .* found None"),
        ((STATE, LANE, np.zeros(20)), TypeError, "curvature_per_m: expected one number"),
        ((STATE, LANE, np.array("0")), TypeError, "curvature_per_m: expected one number"),
        ((STATE, LANE, 0.0, (0.1, 0.0)), TypeError, "applied: expected 3 numbers"),
    ],
)
def test_arguments_that_cannot_be_used_are_refused_by_name_and_not_stored(
    arguments: tuple[Any, ...], error: type[Exception], expected: str
) -> None:
    controller = Controller.load("lti")
    with pytest.raises(error, match=f"^{expected}"):
        controller.step(*arguments)
    assert controller.step(STATE, LANE, 0.0).is_solved


def test_arrays_are_taken(controller: Controller, another: Controller) -> None:
    first = another.step(STATE, LANE, 0.001)
    again = controller.step(np.array(STATE), list(LANE), np.array(0.001))  # type: ignore[arg-type]
    np.testing.assert_array_equal(again.inputs, first.inputs)


def test_a_preview_stands_in_place_of_the_curvature(
    controller: Controller, another: Controller
) -> None:
    straight = another.step(STATE, LANE, 0.0)
    same = controller.step(STATE, LANE, CurvaturePreview(3.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(same.inputs, straight.inputs, atol=1e-9)
    controller.reset()
    another.reset()
    bend = fit_preview(np.where(np.arange(33) < 16, 0.0, 0.005), 12.0)
    turning = another.step(STATE, LANE, bend)
    assert turning.inputs[:8, 2].mean() > straight.inputs[:8, 2].mean() + 0.01
    again = controller.step(STATE, LANE, list(bend))  # type: ignore[arg-type]
    np.testing.assert_allclose(again.inputs, turning.inputs, atol=1e-9)


def test_a_controller_is_made_of_a_model_and_settings_and_refuses_others() -> None:
    make: Any = Controller
    assert make("lti").bundle.name == "lti"
    with pytest.raises(TypeError, match="expected a ControllerConfig, found dict"):
        make.load("lti", {"mpc": {"horizon": 9}})
    with pytest.raises(TypeError, match="model: expected the name of a shipped model"):
        make.load(5)
    config = ControllerConfig(model="lti")
    assert Controller.load(config=config).bundle.name == "lti"


@pytest.mark.parametrize("A", [np.full((6, 6), np.nan), np.eye(5), np.eye(6) * 1j])
def test_a_linear_model_of_other_matrices_is_refused(A: np.ndarray) -> None:
    with pytest.raises(ArtifactError, match=r"^A: expected"):
        Bundle.linear(A, np.zeros((6, 3)), np.zeros((6, 1)))


def test_a_controller_takes_a_bundle_and_settings() -> None:
    bundle = load_bundle(shipped_model("lti"))
    config = ControllerConfig(mpc=MpcSettings(horizon=8))
    plan = Controller.load(bundle, config).step(STATE, LANE, 0.0)
    assert plan.inputs.shape == (8, 3)
