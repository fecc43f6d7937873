"""One description of the car: what a table [car] may say, and who reads it."""

import math
import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from rt_controller import ControllerConfig, simulate
from rt_controller.bus.messages import Command
from rt_controller.contract.car import CAR_VALUES, DEFAULT_CAR, THRESHOLDS, UNNAMED_CAR, Car, car_of
from rt_controller.contract.faults import NO_REFUSAL, Refusal, StopCause
from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import AT_REST, NEUTRAL_INPUT, Mode, PathReference
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.program import SolveStatus
from rt_controller.mapping.tables import CarData
from rt_controller.model.artifact import load_bundle, save_bundle, shipped_model
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_mpc
from rt_controller.safety.checks import CHECKS, checks_of
from rt_controller.vehicle.vehicle_envelope import OwnMotion, refusals

TABLE = """
wheelbase_m = 2.7
rear_axle_m = 1.4
steering_ratio = 15.0
lock_rad = 8.0
largest_brake_n = 90.0
steer_rate_radps = 1.2
brake_mps2_per_n = 0.1
largest_lateral_mps2 = 4.0
path_lateral_mps2 = 5.0
thresholds = { tracking_m = 0.5 }
"""
OWN = CarData.model_validate(tomllib.loads(TABLE)).car


def test_a_table_gives_the_car_and_the_rest_is_that_of_the_default_car():
    assert OWN.geometry == (2.7, 1.4, 15.0, 8.0)
    assert OWN.limits.upper == DEFAULT_CAR.limits.upper._replace(brake_n=90.0)
    assert OWN.limits.rate_per_s == DEFAULT_CAR.limits.rate_per_s._replace(steer_rad=1.2)
    assert (OWN.plan_lateral_mps2, OWN.throttle_mps2, OWN.force_scale) == (7.0, None, 0.5)
    assert DEFAULT_CAR.own_values == UNNAMED_CAR.own_values == {}


def test_a_bundle_carries_the_whole_car(tmp_path):
    bundle = replace(load_bundle(shipped_model("lti")), car=OWN)
    save_bundle(tmp_path, bundle, "card")
    loaded = load_bundle(tmp_path)
    assert loaded.car == OWN
    assert loaded.sha256 == bundle.sha256 != replace(bundle, car=Car(*OWN.geometry)).sha256


@pytest.mark.parametrize("name", CAR_VALUES)
def test_a_value_outside_its_range_is_named_with_the_range(name):
    low, high, *_ = CAR_VALUES[name]
    car_of({name: high})
    for wrong in (low - 0.01, 1.01 * high):
        with pytest.raises(ValueError, match=rf"{name}: expected {low:g} to {high:g}, found"):
            car_of({name: wrong})


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"steering_ratio": True}, "steering_ratio: expected a number, found True"),
        ({"lock_rad": "8"}, "lock_rad: expected a number, found '8'"),
        ({"wheel_base_m": 3.0}, "wheel_base_m: no such value (did you mean wheelbase_m?)"),
        ({"thresholds": {"hedaing_rad": 1.0}}, "hedaing_rad: no such value (did you mean heading"),
        ({"thresholds": {"heading_rad": math.inf}}, "heading_rad: expected 1e-06 to 1e+06, found"),
        ({"thresholds": {"heading_rad": 0.0}}, "heading_rad: expected 1e-06 to 1e+06, found 0"),
        ({"thresholds": 5}, "thresholds: expected a table, found 5"),
        ({"largest_brake_n": 10**400}, "largest_brake_n: expected 10 to 150, found 1000"),
    ],
)
def test_a_wrong_table_is_refused(table, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        car_of(table)
    complete = {"wheelbase_m": 2.7, "rear_axle_m": 1.4, "steering_ratio": 15.0, **table}
    with pytest.raises(ValueError, match="1 validation error for CarData"):
        CarData.model_validate(complete)


def test_thresholds_of_the_car_replace_those_of_the_table():
    found = {check.quantity: check.threshold for check in checks_of(OWN)}
    changed = {Quantity.TRACKING_M: 0.5, Quantity.PATH_LATERAL_MPS2: 5.5, Quantity.BRAKE_N: 5.0}
    assert found == {check.quantity: check.threshold for check in CHECKS} | changed
    assert checks_of(DEFAULT_CAR) == CHECKS
    assert set(THRESHOLDS) == {check.quantity.name.lower() for check in CHECKS}


def test_the_envelope_of_the_vehicle_is_that_of_its_car():
    def found(control, before=NEUTRAL_INPUT):
        motion = OwnMotion(25.0, 0.0, is_mission_on=True)
        return refusals(Command(control, Mode.NOMINAL), before, 1, motion, OWN)

    assert found(NEUTRAL_INPUT._replace(brake_n=90.0)) == NO_REFUSAL
    assert found(NEUTRAL_INPUT._replace(brake_n=91.0)) == Refusal.STEERING
    turned = NEUTRAL_INPUT._replace(steer_rad=1.2 * PERIOD_S)
    assert found(turned) == NO_REFUSAL
    assert found(turned._replace(steer_rad=1.3 * PERIOD_S)) == Refusal.STEERING
    wide = NEUTRAL_INPUT._replace(steer_rad=0.5)
    assert found(wide, wide) == Refusal.LATERAL_ACCELERATION


def test_the_plan_knows_the_bounds_of_the_car():
    """A strong braking: the plan itself, not only what is sent, stays within the limits."""
    own = car_of({"largest_brake_n": 40.0, "brake_rate_n_per_s": 80.0, "throttle_rate_per_s": 0.5})
    mpc = build_mpc(replace(Bundle.load(), car=own, plans=None), ControllerConfig().mpc)
    state = AT_REST._replace(vx_mps=25.0, ds_m=25.0 * PERIOD_S)
    slower = PathReference(0.0, 0.0, 0.0, 0.0, 12.0, -4.0)
    for applied in (NEUTRAL_INPUT, NEUTRAL_INPUT._replace(brake_n=60.0)):
        assert mpc.plan(state, 0.0, slower, applied) is SolveStatus.SOLVED
        brake_n = np.concatenate([[applied.brake_n], mpc.inputs[:, 1]])
        assert brake_n.max() <= max(40.0, applied.brake_n) + 1e-6
        assert np.abs(np.diff(brake_n)).max() <= 80.0 * PERIOD_S + 1e-6
    assert mpc.inputs[-1, 1] <= 40.0 + 1e-6
    faster = PathReference(0.0, 0.0, 0.0, 0.0, 40.0, 4.0)
    for _ in range(20):
        assert mpc.plan(state, 0.0, faster, NEUTRAL_INPUT) is SolveStatus.SOLVED
    throttle = np.concatenate([[0.0], mpc.inputs[:, 0]])
    assert np.diff(throttle).max() <= 0.5 * PERIOD_S + 1e-6


def test_a_drive_keeps_the_limits_of_the_car():
    """The default car with a slow wheel and a weak brake, of which the plan knows."""
    own = car_of({**DEFAULT_CAR.geometry._asdict(), "steer_rate_radps": 1.5, "largest_brake_n": 40})
    model = replace(Bundle.load(), car=own, plans=None)
    drive = simulate("double_lane_change", model=model)
    assert np.abs(np.diff(drive["steer_rad"])).max() == pytest.approx(1.5 * PERIOD_S)
    assert (drive.stop_cause, drive.errors.ey_rms_m < 0.01) == (StopCause.NONE.name, True)
    stop = simulate("straight", model=model, duration_s=2.0)
    assert stop["brake_n"].max() == 40.0
    assert stop["vx_mps"][-1] < 1.0
