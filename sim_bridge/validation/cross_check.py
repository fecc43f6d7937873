"""Test 4: the plant with the parameters of a reference model against that model.

The reference model is the multi-body car of `commonroad-vehicle-models`, vehicle 2, as installed
and unmodified. Both are steered by a ramp of the road wheel at constant speed.
Althoff and Würsching, "CommonRoad: Vehicle Models", 2020.
"""

from dataclasses import dataclass

import numpy as np
from numpy import float64

from rt_controller.contract.arrays import Array
from sim_bridge.adapters.commonroad import ROLL, STEER, VX, YAW_RATE, MultiBodyModel
from sim_bridge.plant.parameters import Parameters
from sim_bridge.validation.driver_model import steer_open_loop
from sim_bridge.validation.signal_metrics import step_response

SPEED_MPS = 22.2
RATE_RADPS = 0.4
ROAD_WHEEL_RAD = (0.01, 0.02, 0.03, -0.01, -0.02, -0.03)
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


def measure(
    parameters: Parameters,
) -> tuple[tuple[tuple[Turn, Turn], ...], dict[str, float], dict[str, float]]:
    """All turns, of the plant and of the reference model, and the values of both by line.

    Raises:
        MissingExtraError: the reference model is not installed.
    """
    model = MultiBodyModel(2, "the cross-check of test 4")
    pairs = tuple(
        (_turn(parameters, angle_rad), _reference_turn(model, angle_rad))
        for angle_rad in ROAD_WHEEL_RAD
    )
    reached: dict[str, float] = {}
    expected: dict[str, float] = {}
    for angle_rad, (ours, reference) in zip(ROAD_WHEEL_RAD, pairs, strict=True):
        reached |= _values(ours, f"at {angle_rad:+.2f} rad")
        expected |= _values(reference, f"at {angle_rad:+.2f} rad")
        if angle_rad > 0.0:  # also compared with what version 3.0.2 gave, whatever is installed
            reached |= _values(ours, f"at {angle_rad:+.2f} rad", ", version 3.0.2")
    return pairs, reached, expected


def _values(turn: Turn, angle: str, version: str = "") -> dict[str, float]:
    yaw_rate = step_response(turn.time_s, turn.yaw_rate_degps, 0.0)
    return {
        f"yaw rate {angle}{version}": yaw_rate.steady,
        f"roll {angle}{version}": step_response(turn.time_s, turn.roll_deg, 0.0).steady,
        f"rise time {angle}{version}": yaw_rate.t90_s,
    }


def _turn(parameters: Parameters, angle_rad: float) -> Turn:
    def steer_rad(time_s: float) -> float:
        largest_rad = RATE_RADPS * (time_s + 0.5 * _DRIVER_PERIOD_S)
        return parameters.steering.ratio * float(np.clip(angle_rad, -largest_rad, largest_rad))

    run = steer_open_loop(parameters, SPEED_MPS, steer_rad, DURATION_S, _DRIVER_PERIOD_S)
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
