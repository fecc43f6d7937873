"""Test 1: properties that hold for any car, independent of its parameters."""

from math import pi, radians

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import StateColumn
from sim_bridge.plant.library import STEP_S
from sim_bridge.plant.parameters import Parameters
from sim_bridge.scenario import load_scenario
from sim_bridge.validation.driver_model import DRIVER_PERIOD_S, PreviewDriver, fit_driver_model
from sim_bridge.validation.run import Run, input_table, replay, run_driver
from sim_bridge.validation.signal_metrics import largest_gain, peak

_SPEED_MPS = 80.0 / 3.6
_PREVIEW_S = 0.8


def measure(parameters: Parameters) -> dict[str, float]:
    """Loads at rest, a mirrored run, a halved step, and two runs without drive, by line."""
    at_rest = replay(parameters, 0.0, input_table(20, brake_n=150.0), 0.1)
    yaw_rate_change_degps, lateral_change_m = _halving(parameters)
    straight_gain = _gain(parameters, 130.0 / 3.6, 0.0, 40.0)
    turning_gain = _gain(parameters, 100.0 / 3.6, radians(20.0), 8.0)
    return {
        "front wheel load at rest": float(np.mean(at_rest.loads_n[-1, :2])),
        "rear wheel load at rest": float(np.mean(at_rest.loads_n[-1, 2:])),
        "largest difference of the mirrored run": _mirror_error(parameters),
        "yaw rate change with half the step": yaw_rate_change_degps,
        "lateral position change with half the step": 1e3 * lateral_change_m,
        "energy gain while coasting straight": 100.0 * straight_gain,
        "energy gain while coasting in a turn": 100.0 * turning_gain,
    }


def _mirror_error(parameters: Parameters) -> float:
    """Difference between a slalom with drive and brake and the mirrored one: m/s, rad/s, rad."""
    time_s = np.arange(0.0, 5.0, DRIVER_PERIOD_S)
    inputs = input_table(
        len(time_s),
        throttle=np.where(time_s < 2.5, 0.6, 0.0),
        brake_n=np.where(time_s >= 3.0, 60.0, 0.0),
        steer_rad=np.radians(90.0) * np.sin(2.0 * np.pi * 0.5 * time_s),
    )
    left = replay(parameters, _SPEED_MPS, inputs, DRIVER_PERIOD_S)
    right = replay(parameters, _SPEED_MPS, inputs * (1.0, 1.0, -1.0), DRIVER_PERIOD_S)
    differences = (
        left.motion - right.motion * (1.0, -1.0, -1.0),
        left.pose - right.pose * (1.0, -1.0, -1.0),
        left.column("roll_rad") + right.column("roll_rad"),
        left.column("pitch_rad") - right.column("pitch_rad"),
    )
    return peak(np.concatenate([difference.ravel() for difference in differences]))


def _halving(parameters: Parameters) -> tuple[float, float]:
    """Change of yaw rate (deg/s) and lateral position (m) with half the step in a lane change."""
    scenario = load_scenario("double_lane_change")
    driver = PreviewDriver(
        scenario.ey_m, _PREVIEW_S, fit_driver_model(parameters, scenario.start.speed_mps)
    )
    driven = run_driver(
        parameters, scenario.start.speed_mps, driver, scenario.duration_s, DRIVER_PERIOD_S
    )
    coarse, fine = (
        replay(parameters, scenario.start.speed_mps, driven.inputs[1:], DRIVER_PERIOD_S, step_s)
        for step_s in (STEP_S, 0.5 * STEP_S)
    )
    return (peak(coarse.yaw_rate_degps - fine.yaw_rate_degps), peak(coarse.y_m - fine.y_m))


def _gain(parameters: Parameters, v0_mps: float, steer_rad: float, duration_s: float) -> float:
    """Gain of kinetic energy while coasting, as a share of the initial energy."""
    periods = round(duration_s / DRIVER_PERIOD_S)
    run = replay(parameters, v0_mps, input_table(periods, steer_rad=steer_rad), DRIVER_PERIOD_S)
    return largest_gain(_kinetic_energy_j(run, parameters))


def _kinetic_energy_j(run: Run, parameters: Parameters) -> Array:
    """Kinetic energy of body, wheels and engine; energy in springs and shafts is small."""
    body = parameters.body
    engine_radps = run.column("engine_rpm") * pi / 30.0
    energy_j: Array = 0.5 * (
        body.mass_kg * np.sum(run.motion[:, : StateColumn.yaw_rate_radps] ** 2, axis=1)
        + body.yaw_inertia_kgm2 * run.motion[:, StateColumn.yaw_rate_radps] ** 2
        + parameters.tyre.spin_inertia_kgm2 * np.sum(run.spins_radps**2, axis=1)
        + parameters.engine.inertia_kgm2 * engine_radps**2
    )
    return energy_j
