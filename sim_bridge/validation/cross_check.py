"""Test 4: the plant with the parameters of a reference model against that model.

The reference model is the multi-body car of `commonroad-vehicle-models`, vehicle 2, as installed
and unmodified. Both are steered by a ramp of the road wheel at constant speed.
Althoff and Würsching, "CommonRoad: Vehicle Models", 2020.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy import float64

from rt_controller.contract.arrays import Array
from sim_bridge.adapters.commonroad import ROLL, STEER, VX, YAW_RATE, MultiBodyModel
from sim_bridge.plant.parameters import Parameters
from sim_bridge.validation.acceptance import Line, near, within
from sim_bridge.validation.driver_model import OpenLoopDriver, SpeedControl
from sim_bridge.validation.run import cruising_throttle, run_driver
from sim_bridge.validation.signal_metrics import step_response

SPEED_MPS = 22.2
RATE_RADPS = 0.4
ROAD_WHEEL_RAD = (0.01, 0.02, 0.03, -0.01, -0.02, -0.03)
RECORDED = {0.01: (5.04, 1.77), 0.02: (10.02, 3.53), 0.03: (14.84, 5.26)}
"""yaw rate in deg/s and roll in deg by road-wheel angle, as recorded with version 3.0.2: targets
that do not depend on the installed version"""
DURATION_S = 3.0
_DRIVER_PERIOD_S = 0.005
_STEP_S = 0.001
_HOLDING_PS = 5.0


@dataclass(frozen=True, slots=True)
class Turn:
    """Response to a ramp; left is positive, and positive roll lowers the right side."""

    time_s: Array
    yaw_rate_degps: Array
    roll_deg: Array


def measure(parameters: Parameters) -> tuple[tuple[tuple[Turn, Turn], ...], tuple[Line, ...]]:
    """All turns of the test, of the plant and of the reference model, and their lines.

    Raises:
        MissingExtraError: the reference model is not installed.
    """
    model = MultiBodyModel(2, "the cross-check of test 4")
    throttle = cruising_throttle(parameters, SPEED_MPS)
    pairs = tuple(
        (_turn(parameters, throttle, angle_rad), _reference_turn(model, angle_rad))
        for angle_rad in ROAD_WHEEL_RAD
    )
    lines: list[Line] = []
    for angle_rad, (ours, reference) in zip(ROAD_WHEEL_RAD, pairs, strict=True):
        lines += _lines(angle_rad, ours, reference)
    return pairs, tuple(lines)


def _lines(angle_rad: float, ours: Turn, reference: Turn) -> Iterator[Line]:
    turn = f"at {angle_rad:+.2f} rad"
    yaw_rate = step_response(ours.time_s, ours.yaw_rate_degps, 0.0)
    roll_deg = step_response(ours.time_s, ours.roll_deg, 0.0).steady
    wanted_degps = step_response(reference.time_s, reference.yaw_rate_degps, 0.0).steady
    wanted_deg = step_response(reference.time_s, reference.roll_deg, 0.0).steady
    yield Line(f"yaw rate {turn}", "deg/s", yaw_rate.steady, within(wanted_degps, 0.03))
    yield Line(f"roll {turn}", "deg", roll_deg, within(wanted_deg, 0.1))
    yield Line(f"rise time {turn}", "s", yaw_rate.t90_s, near(0.29, 0.02, "s"))
    if angle_rad in RECORDED:
        recorded_degps, recorded_deg = RECORDED[angle_rad]
        goal = within(recorded_degps, 0.03)
        yield Line(f"yaw rate {turn}, version 3.0.2", "deg/s", yaw_rate.steady, goal)
        yield Line(f"roll {turn}, version 3.0.2", "deg", roll_deg, within(recorded_deg, 0.1))


def _turn(parameters: Parameters, throttle: float, angle_rad: float) -> Turn:
    def steer_rad(time_s: float) -> float:
        return parameters.steering.ratio * float(
            np.clip(angle_rad, -RATE_RADPS * time_s, RATE_RADPS * time_s)
        )

    speed = SpeedControl(SPEED_MPS, throttle, _DRIVER_PERIOD_S)
    driver = OpenLoopDriver(lambda time_s: steer_rad(time_s + 0.5 * _DRIVER_PERIOD_S), speed)
    run = run_driver(parameters, SPEED_MPS, driver, DURATION_S, _DRIVER_PERIOD_S)
    return Turn(run.time_s, run.yaw_rate_degps, run.roll_deg)


def _reference_turn(model: MultiBodyModel, angle_rad: float) -> Turn:
    """The turn of the reference model with the midpoint rule.

    Its roll has the opposite sign, because its vertical axis points down.
    """
    n_steps = round(DURATION_S / _STEP_S)
    start = model.initial_state(SPEED_MPS)
    states = np.empty((n_steps + 1, len(start)))
    states[0] = start
    for k in range(n_steps):
        x = states[k]
        inputs = (
            float(np.clip((angle_rad - x[STEER]) / _STEP_S, -RATE_RADPS, RATE_RADPS)),
            float(_HOLDING_PS * (SPEED_MPS - x[VX])),
        )
        middle = x + 0.5 * _STEP_S * model.rate(x, inputs)
        states[k + 1] = x + _STEP_S * model.rate(middle, inputs)
    return Turn(
        _STEP_S * np.arange(n_steps + 1, dtype=float64),
        np.degrees(states[:, YAW_RATE]),
        -np.degrees(states[:, ROLL]),
    )
