"""The public names: light to import, and a controller that plans like the program."""

import math
import re
import subprocess
import sys
from importlib.metadata import version
from typing import Any, get_args

import can
import numpy as np
import pytest

import rt_controller
from rt_controller import (
    ControlInput,
    Controller,
    ControllerConfig,
    CurvaturePreview,
    MpcSettings,
    PathReference,
    VehicleState,
    fit_preview,
)
from rt_controller.bus import transport
from rt_controller.config import ShippedModel, Tolerances
from rt_controller.contract.errors import ConfigError, RtControllerError
from rt_controller.contract.signals import AT_REST, NEUTRAL_INPUT, Mode
from rt_controller.control.program import SolveStatus
from rt_controller.drive.trace import DriveTrace
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.safety.tick import Tick
from rt_controller.settings import (
    BusSettings,
    CarSettings,
    CommonInterface,
    ShippedCar,
    ShippedScenario,
)
from sim_bridge.toml_file import shipped_names

STATE = VehicleState(20.0, 0.0, 0.0, 0.5, 0.3, 0.0)
LANE = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)


@pytest.fixture(params=["lti", "mdk-net"])
def controller(request: pytest.FixtureRequest) -> Controller:
    return Controller.load(request.param)


@pytest.fixture
def another(request: pytest.FixtureRequest) -> Controller:
    """A second controller with the model of `controller`."""
    return Controller.load(request.node.callspec.params["controller"])


def test_the_package_imports_nothing_heavy():
    program = (
        "import sys, rt_controller\n"
        "sys.exit(bool({'numpy', 'can', 'onnxruntime', 'pydantic'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_every_public_name_can_be_imported():
    assert all(getattr(rt_controller, name) is not None for name in dir(rt_controller))
    assert set(rt_controller.__all__) < set(dir(rt_controller))
    assert rt_controller.__version__ == version("rt-controller")
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        _ = rt_controller.Nothing


def test_a_plan_has_inputs_and_predicted_states_over_the_horizon(controller):
    plan = controller.step(STATE, LANE, 0.0)
    assert plan.is_solved
    horizon = {"mdk-net": 40, "lti": 20}[controller.bundle.name]
    assert plan.inputs.shape == (horizon, 3)
    assert plan.states.shape == (horizon + 1, 6)
    np.testing.assert_array_equal(plan.states[0], STATE)
    assert plan.time_s[-1] == pytest.approx(horizon * 0.025)
    assert plan.control.steer_rad < 0.0  # the car is left of its lane
    assert plan.states[-1, 4] < STATE.ey_m


def test_the_model_brought_back_to_its_lane_stays_there(controller):
    state = STATE
    # Predicted again and again, the progress of lti grows.
    for _ in range({"mdk-net": 250, "lti": 120}[controller.bundle.name]):
        plan = controller.step(state, LANE, 0.0)
        state = VehicleState(*plan.states[1].tolist())
    assert abs(state.ey_m) < 0.05


def test_a_reset_controller_plans_as_a_new_one(controller):
    first = controller.step(STATE, LANE, 0.0)
    controller.step(STATE._replace(ey_m=-0.5), LANE, 0.001)
    controller.reset()
    again = controller.step(STATE, LANE, 0.0).inputs
    np.testing.assert_allclose(again, first.inputs, atol=1e-6)  # the solver's accuracy


def test_a_problem_without_a_solution_gives_no_plan(controller, monkeypatch):
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
        ((STATE, LANE._replace(v_mps=120.0), 0.0), ValueError, "path.v_mps: expected 0 to 100, f"),
        ((STATE, LANE, 5.0), ValueError, "curvature_per_m: .* at most 0.16 1/m, found 5"),
        ((STATE, LANE, NAN), ValueError, "curvature_per_m: expected .*, found nan"),
        ((STATE, LANE, FLAT._replace(spacing_m=0.0)), ValueError, ".* 0.05 to 65.5 m.*, found 0 "),
        ((STATE, LANE, FLAT._replace(k1_per_m=-0.2)), ValueError, ".* at most 0.16.*found -0.2 "),
        ((STATE, LANE, 0.0, ControlInput(NAN, 0.0, 0.0)), ValueError, "applied: expected finite"),
        ((STATE[:5], LANE, 0.0), TypeError, r"state: expected 6 numbers \(vx_mps, .* found \(20"),
        ((LANE, STATE, 0.0), TypeError, "state: expected 6 numbers .* found PathReference"),
        ((STATE, None, 0.0), TypeError, "path: expected 6 numbers .* found None"),
        ((STATE, LANE, np.zeros(20)), TypeError, "curvature_per_m: expected one number"),
        ((STATE, LANE, 0.0, (0.1, 0.0)), TypeError, "applied: expected 3 numbers"),
    ],
)
def test_arguments_that_cannot_be_used_are_refused_by_name_and_not_stored(
    arguments, error, expected
):
    controller = Controller.load("lti")
    with pytest.raises(error, match=f"^{expected}"):
        controller.step(*arguments)
    assert controller.step(STATE, LANE, 0.0).is_solved


def test_a_preview_stands_in_place_of_the_curvature(controller, another):
    straight = another.step(STATE, LANE, 0.0)
    same = controller.step(STATE, LANE, CurvaturePreview(3.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(same.inputs, straight.inputs, atol=1e-9)
    controller.reset()
    another.reset()
    bend = fit_preview(np.where(np.arange(33) < 16, 0.0, 0.005), 12.0)
    turning = another.step(STATE, LANE, bend)
    assert turning.inputs[:8, 2].mean() > straight.inputs[:8, 2].mean() + 0.01
    again = controller.step(STATE, LANE, list(bend))
    np.testing.assert_allclose(again.inputs, turning.inputs, atol=1e-9)


def test_a_controller_is_made_of_a_model_and_settings_and_refuses_others():
    make: Any = Controller
    assert make("lti").bundle.name == "lti"
    with pytest.raises(TypeError, match="expected a ControllerConfig, found dict"):
        make.load("lti", {"mpc": {"horizon": 9}})
    with pytest.raises(TypeError, match="model: expected the name of a shipped model"):
        make.load(5)
    config = ControllerConfig(model="lti", mpc=MpcSettings(horizon=8))
    controller = Controller.load(config=config)
    assert controller.bundle.name == "lti"
    plan = controller.step(np.array(STATE), list(LANE), np.array(0.001))
    assert plan.inputs.shape == (8, 3)


@pytest.mark.parametrize(
    ("table", "values", "expected"),
    [
        (MpcSettings, {"horizon": 1}, "MpcSettings.horizon: expected at least 3, found 1."),
        (MpcSettings, {"horizont": 9}, "horizont: no such setting (did you mean horizon?)."),
        (ControllerConfig, {"mpc": {"tolerance": {"ey_m": 0}}}, "mpc.tolerance.ey_m: expected"),
        (CarSettings, {"car": 4}, "CarSettings.car: expected 'c_class_150kw_awd', "),
        (ControllerConfig, {"model": 5}, "or 'lti', or a text, or a path, found 5."),
        (BusSettings, {"bus": "socketcan", "bus_option": {"fd": True}}, "bus_option.fd: expected"),
    ],
)
def test_a_refused_field_is_named_with_what_was_expected_and_found(table, values, expected):
    with pytest.raises(ConfigError, match=re.escape(expected)):
        table(**values)


def test_an_error_raised_in_python_names_no_option():
    tolerance = Tolerances(throttle_change=np.inf, brake_change_n=np.inf, steer_change_deg=np.inf)
    config = ControllerConfig(mpc=MpcSettings(tolerance=tolerance))
    with pytest.raises(RtControllerError, match=r"`mpc\.tolerance`") as refused:
        Controller.load("mdk-net", config)
    assert "--" not in str(refused.value)


def test_the_choices_in_the_help_are_what_is_shipped():
    models = {folder.name for folder in shipped_model().parent.iterdir()}
    assert set(get_args(ShippedModel)) == models
    assert set(get_args(ShippedScenario)) == set(shipped_names("scenarios"))
    assert set(get_args(ShippedCar)) == set(shipped_names("cars"))
    assert get_args(CommonInterface) == transport.COMMON
    assert set(transport.COMMON) <= {*can.VALID_INTERFACES, "remote"}


@pytest.mark.parametrize(
    ("model", "given", "horizon", "heading"),
    [
        ("mdk-net", {}, 40, "course"),
        ("mdk-net", {"preset": "paper"}, 20, "epsi"),
        ("mdk-net", {"preset": "paper", "horizon": 30}, 30, "epsi"),
        ("lti", {}, 20, "epsi"),
        ("lti", {"preset": "course"}, 40, "course"),
    ],
)
def test_a_preset_sets_what_is_not_given(model, given, horizon, heading):
    found = MpcSettings(**given).for_model(load_bundle(shipped_model(model)))
    assert (found.horizon, found.heading) == (horizon, heading)


def test_the_speed_error_leaves_out_a_safe_stop():
    trace, path = DriveTrace(10), PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)
    for mode, vx_mps in ((Mode.NOMINAL, 20.5), (Mode.SAFE_STOP, 3.0)):
        state = AT_REST._replace(vx_mps=vx_mps, ey_m=0.1)
        trace.record(Tick(mode=mode, state=state, path=path, control=NEUTRAL_INPUT), 0)
    errors = trace.errors()
    assert (errors.vx_rms_mps, errors.vx_peak_mps) == pytest.approx((0.5, 0.5))
    assert errors.ey_rms_m == pytest.approx(0.1)


def test_arc_length_begins_with_the_drive_and_counts_lost_states():
    trace = DriveTrace(10)
    moving = AT_REST._replace(vx_mps=20.0, ds_m=0.5)
    for mode, is_received in (
        (Mode.STANDBY, True), (Mode.NOMINAL, True), (Mode.NOMINAL, True), (Mode.HOLD_PLAN, False),
        (Mode.NOMINAL, True), (Mode.STANDBY, True),
    ):  # fmt: skip
        state = moving if is_received else None
        trace.record(Tick(mode=mode, state=state, control=NEUTRAL_INPUT), 0)
    found = trace.drive("model", "over")["s_m"]
    np.testing.assert_allclose(found, [0.0, 0.0, 0.5, 1.0, 1.5, 2.0])
