"""Test 1: what has to hold for any car, whatever its parameters."""

from dataclasses import dataclass
from math import pi, radians

import numpy as np

from sim_bridge.plant.integrate import STEP_S
from sim_bridge.plant.parameters import Parameters
from sim_bridge.scenario import load_scenario
from sim_bridge.validation.measures import largest_gain, peak
from sim_bridge.validation.preview import PERIOD_S, PreviewDriver, get_familiar
from sim_bridge.validation.run import Array, Run, drive, replay

_SPEED_MPS = 80.0 / 3.6
_PREVIEW_S = 0.8


@dataclass(frozen=True, slots=True)
class Numerics:
    """The numbers of test 1."""

    front_load_n: float
    """of a front wheel of the car at rest"""
    rear_load_n: float
    mirror_error: float
    """largest difference between a run and the mirrored one, in m/s, rad/s, rad"""
    yaw_rate_change_degps: float
    """by halving the step, in the lane change that ships with the package"""
    lateral_change_m: float
    straight_gain: float
    """of kinetic energy while coasting straight ahead, a share of the first"""
    turning_gain: float


def measure(parameters: Parameters) -> Numerics:
    """Loads at rest, a mirrored run, a halved step, and two runs without drive."""
    at_rest = replay(parameters, 0.0, np.tile((0.0, 150.0, 0.0), (20, 1)), 0.1)
    yaw_rate_change_degps, lateral_change_m = _halving(parameters)
    return Numerics(
        front_load_n=float(np.mean(at_rest.loads_n[-1, :2])),
        rear_load_n=float(np.mean(at_rest.loads_n[-1, 2:])),
        mirror_error=_mirror_error(parameters),
        yaw_rate_change_degps=yaw_rate_change_degps,
        lateral_change_m=lateral_change_m,
        straight_gain=_gain(parameters, 130.0 / 3.6, 0.0, 40.0),
        turning_gain=_gain(parameters, 100.0 / 3.6, radians(20.0), 8.0),
    )


def _mirror_error(parameters: Parameters) -> float:
    """A hard slalom with drive and brake in it, to the left and to the right."""
    time_s = np.arange(0.0, 5.0, PERIOD_S)
    inputs = np.stack(
        (
            np.where(time_s < 2.5, 0.6, 0.0),
            np.where(time_s >= 3.0, 60.0, 0.0),
            np.radians(90.0) * np.sin(2.0 * np.pi * 0.5 * time_s),
        ),
        axis=1,
    )
    left = replay(parameters, _SPEED_MPS, inputs, PERIOD_S)
    right = replay(parameters, _SPEED_MPS, inputs * (1.0, 1.0, -1.0), PERIOD_S)
    differences = (
        left.motion - right.motion * (1.0, -1.0, -1.0),
        left.pose - right.pose * (1.0, -1.0, -1.0),
        left.seen("roll_rad") + right.seen("roll_rad"),
        left.seen("pitch_rad") - right.seen("pitch_rad"),
    )
    return peak(np.concatenate([difference.ravel() for difference in differences]))


def _halving(parameters: Parameters) -> tuple[float, float]:
    """Yaw rate (deg/s) and way to the left (m) that a lane change gains by half the step."""
    scenario = load_scenario("double_lane_change")
    driver = PreviewDriver(
        scenario.lateral_m, _PREVIEW_S, get_familiar(parameters, scenario.speed_mps)
    )
    driven = drive(parameters, scenario.speed_mps, driver, scenario.duration_s, PERIOD_S)
    coarse, fine = (
        replay(parameters, scenario.speed_mps, driven.inputs[1:], PERIOD_S, step_s)
        for step_s in (STEP_S, 0.5 * STEP_S)
    )
    return (
        peak(coarse.yaw_rate_degps - fine.yaw_rate_degps),
        peak(coarse.pose[:, 1] - fine.pose[:, 1]),
    )


def _gain(parameters: Parameters, v0_mps: float, steer_rad: float, duration_s: float) -> float:
    periods = round(duration_s / PERIOD_S)
    run = replay(parameters, v0_mps, np.tile((0.0, 0.0, steer_rad), (periods, 1)), PERIOD_S)
    return largest_gain(_kinetic_energy_j(run, parameters))


def _kinetic_energy_j(run: Run, parameters: Parameters) -> Array:
    """Of everything large that moves or turns: springs and shafts pass energy on to each other."""
    body = parameters.body
    engine_radps = run.seen("engine_rpm") * pi / 30.0
    energy_j: Array = 0.5 * (
        body.mass_kg * (run.motion[:, 0] ** 2 + run.motion[:, 1] ** 2)
        + body.yaw_inertia_kgm2 * run.motion[:, 2] ** 2
        + parameters.tyre.spin_inertia_kgm2 * np.sum(run.spins_radps**2, axis=1)
        + parameters.engine.inertia_kgm2 * engine_radps**2
    )
    return energy_j
