"""Test 10: heave, roll and pitch of the body, and the load transfer between the wheels."""

from dataclasses import dataclass
from math import hypot, log, nan, pi, sqrt

import numpy as np
from numpy import float64

from rt_controller.contract.arrays import Array
from rt_controller.contract.physics import GRAVITY_MPS2
from sim_bridge.plant.library import STEP_S, settle, simulate
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.protocol import PlantOutputs
from sim_bridge.plant.states import AT
from sim_bridge.validation.cornering import is_linear
from sim_bridge.validation.run import Run, cruising_throttle, input_table, replay
from sim_bridge.validation.signal_metrics import slope

SPEED_MPS = 20.0
HEAVE_M = 0.05
SMALL_HEAVE_M = 0.015
"""the stops of the suspension do not act on this travel"""
ROLL_RAD = 0.04
_BRAKING_MPS = 100.0 / 3.6
_BRAKE_N = 50.0
_DURATION_S = 3.0
_STEPS_PER_SAMPLE = 2
_LAST_PART = slice(-20, None)


@dataclass(frozen=True, slots=True)
class Swing:
    """Motion of the body after its release, about its position at rest."""

    time_s: Array
    position: Array
    """heave in mm, roll in mrad"""


def measure(parameters: Parameters, cornering: Run) -> tuple[tuple[Swing, Swing], dict[str, float]]:
    """The body released from 50 mm and from a roll angle; light braking; a slow turn.

    Args:
        cornering: slowly increasing steer of the same car, see `cornering`.
    """
    heave, roll = released_heave(parameters, HEAVE_M), released_roll(parameters)
    gentle = released_heave(parameters, SMALL_HEAVE_M)
    return (heave, roll), {
        "heave damping, half swing from 50 mm": half_swing_damping(heave),
        "heave damping, whole swing from 50 mm": damping(heave)[0],
        "roll damping, whole swing": damping(roll)[0],
        "natural frequency of heave": damping(gentle)[1],
        "pitch under braking": _pitch_degpg(parameters),
        "load transfer, front axle": _load_transfer_npg(cornering, 0),
        "load transfer, rear axle": _load_transfer_npg(cornering, 2),
    }


def released_heave(parameters: Parameters, height_m: float) -> Swing:
    """The body lifted by `height_m` above the wheels and released, at 20 m/s."""
    outputs = _released(parameters, int(AT.heave_m), height_m)
    wheels = ("front_left", "front_right", "rear_left", "rear_right")
    travel_m = np.mean([_column(outputs, f"travel_{wheel}_m") for wheel in wheels], axis=0)
    return _swing(-1e3 * travel_m.astype(float64))


def released_roll(parameters: Parameters) -> Swing:
    """The body rolled by 40 mrad and released, at 20 m/s."""
    return _swing(1e3 * _column(_released(parameters, int(AT.roll_rad), ROLL_RAD), "roll_rad"))


def damping(swing: Swing) -> tuple[float, float]:
    """Damping ratio, and natural frequency in Hz, from the first whole period.

    The logarithmic decrement from the release to the next peak on the same side, so that jounce and
    rebound count alike; the damped period is the time from the first passage through rest to the
    third. NaN if the body does not swing back.
    """
    position = swing.position * np.sign(swing.position[0])
    passed = np.flatnonzero((position[:-1] > 0.0) != (position[1:] > 0.0))
    if len(passed) < 3:
        return nan, nan
    peak = float(position[passed[1] + 1 : passed[2] + 1].max())
    decrement = log(position[0] / peak)
    ratio = decrement / hypot(2.0 * pi, decrement)
    period_s = _passage_s(swing, passed[2]) - _passage_s(swing, passed[0])
    return ratio, 1.0 / (period_s * sqrt(1.0 - ratio**2))


def half_swing_damping(swing: Swing) -> float:
    """Damping ratio from the release and the first peak on the other side; NaN if there is none.

    With dampers that are softer in jounce than in rebound it depends on the side of the release.
    """
    position = swing.position * np.sign(swing.position[0])
    opposite = -float(position.min())
    if opposite <= 0.0:
        return nan
    decrement = log(position[0] / opposite)
    return decrement / hypot(pi, decrement)


def _passage_s(swing: Swing, k: int) -> float:
    """Time at which the position passes rest between the samples k and k + 1."""
    here, there = swing.position[k], swing.position[k + 1]
    step_s = swing.time_s[k + 1] - swing.time_s[k]
    return float(swing.time_s[k] + step_s * here / (here - there))


def _released(parameters: Parameters, state: int, offset: float) -> Array:
    """Outputs of a car driving straight ahead after one state of its body was moved."""
    start = settle(SPEED_MPS, parameters)
    start[state] += offset
    throttle = cruising_throttle(parameters, SPEED_MPS)
    inputs = input_table(round(_DURATION_S / (_STEPS_PER_SAMPLE * STEP_S)), throttle)
    return simulate(start, inputs, parameters, _STEPS_PER_SAMPLE, STEP_S)[1]


def _column(outputs: Array, name: str) -> Array:
    return outputs[:, PlantOutputs._fields.index(name)]


def _swing(position: Array) -> Swing:
    time_s = _STEPS_PER_SAMPLE * STEP_S * np.arange(len(position), dtype=float64)
    return Swing(time_s, position - float(np.mean(position[_LAST_PART])))


def _pitch_degpg(parameters: Parameters) -> float:
    """Pitch per deceleration while 50 N brake from 100 km/h."""
    run = replay(parameters, _BRAKING_MPS, input_table(150, brake_n=_BRAKE_N), 0.01)
    deceleration_g = -float(np.mean(run.column("ax_mps2")[_LAST_PART])) / GRAVITY_MPS2
    return float(np.degrees(np.mean(run.column("pitch_rad")[_LAST_PART]))) / deceleration_g


def _load_transfer_npg(run: Run, left_wheel: int) -> float:
    """Load of the right wheel of an axle minus that of the left one, per lateral acceleration."""
    difference_n = run.loads_n[:, left_wheel + 1] - run.loads_n[:, left_wheel]
    return slope(run.lateral_g, difference_n, is_linear(run))
