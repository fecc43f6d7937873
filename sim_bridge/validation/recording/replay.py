"""Open-loop replay: the car with the recorded steering and speed, beside the recording."""

from dataclasses import dataclass
from math import atan2, pi, radians
from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.library import N_OUTPUTS, STEP_S, advance, settle, write_outputs
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs
from sim_bridge.plant.states import AT, N_STATES, N_WHEELS
from sim_bridge.validation.recording.comparison import Comparison, compare
from sim_bridge.validation.recording.recording import PERIOD_S, Recording, Signal
from sim_bridge.validation.recording.speed_follower import SpeedFollower

SETTLING_S = 2.0
"""left out of the comparison after a start"""
LARGEST_DEVIATION_RAD = radians(15.0)
"""of the sideslip; a car that is further from the recorded motion has spun"""
SPEED_RATE = "speed_rate_mps2"
"""recorded rate of the speed, and what the pedals alone give the car"""


@dataclass(frozen=True, slots=True)
class Replay:
    """A recording and the answer of the car."""

    recording: Recording
    signals: tuple[tuple[Signal, Signal], ...]
    """recorded and of the car: the rate of the speed, and then each signal of the recording"""
    comparisons: tuple[Comparison, ...]
    """in the order of `signals`"""
    compared_s: float
    """duration of the part that is compared"""
    spins: int
    """how often the car left the recorded motion and was started again"""


class _Drive(NamedTuple):
    """The car over the n samples of a recording."""

    motion: Array
    """(n, 3), columns as `MOTION_FIELDS`"""
    outputs: Array
    """(n, N_OUTPUTS), columns as `PlantOutputs._fields`"""
    rate_mps2: Array
    """(n,) rate of the speed that the pedals gave"""
    starts: list[int]
    """samples at which the car was started"""


def replay_recording(parameters: Parameters, recording: Recording) -> Replay:
    """Drive the car with the recorded steering at the recorded speed; there is no other feedback.

    The pedals follow the recorded speed, so that the tyres have drive and brake forces and the
    wheels their loads. What engine and brakes of the car cannot give is added as a force at the
    centre of gravity, so that the speed is the recorded one. Recorded angles of the road wheels are
    those without compliance: they are multiplied by the steering ratio of the car. A car that spins
    is started again with the recorded motion.
    """
    follower = SpeedFollower(parameters, recording.speed_mps, PERIOD_S)
    drive = _drive(parameters, recording, follower)
    car = dict(
        zip(
            MOTION_FIELDS + PlantOutputs._fields,
            np.hstack((drive.motion, drive.outputs)).T,
            strict=True,
        )
    )
    signals = (
        (Signal(SPEED_RATE, follower.acceleration_mps2), Signal(SPEED_RATE, drive.rate_mps2)),
        *((one, Signal(one.name, car[one.name])) for one in recording.signals),
    )
    is_compared = np.ones(len(drive.motion), dtype=bool)
    for start in drive.starts:
        is_compared[start : start + round(SETTLING_S / PERIOD_S)] = False
    return Replay(
        recording,
        signals,
        tuple(
            compare(recording.name, a.name, a.values, b.values, PERIOD_S, is_compared)
            for a, b in signals
        ),
        PERIOD_S * np.count_nonzero(is_compared),
        len(drive.starts) - 1,
    )


def _drive(parameters: Parameters, recording: Recording, follower: SpeedFollower) -> _Drive:
    ratio = parameters.steering.ratio if recording.is_road_wheel else 1.0
    # The middles of the periods, so that the car is not steered half a period late.
    steer_rad = ratio * 0.5 * (recording.steer_rad[:-1] + recording.steer_rad[1:])
    speed_mps, n = recording.speed_mps, len(recording.speed_mps)
    vy_mps, yaw_rate_radps = (_recorded(recording, name) for name in MOTION_FIELDS[1:])
    motion, outputs, rate_mps2 = np.empty((n, 3)), np.empty((n, N_OUTPUTS)), np.zeros(n)
    steps = np.empty((round(PERIOD_S / STEP_S), 3))
    control = ControlInput(0.0, 0.0, 0.0)
    state, starts = np.zeros(N_STATES), []
    record = car_record(parameters)
    for k in range(n):
        sideslip_rad = atan2(state[AT.vy_mps], speed_mps[k]) - atan2(vy_mps[k], speed_mps[k])
        if k == 0 or not abs(sideslip_rad) <= LARGEST_DEVIATION_RAD:
            state = settle(float(speed_mps[k]), parameters)
            state[AT.vy_mps], state[AT.yaw_rate_radps] = vy_mps[k], yaw_rate_radps[k]
            starts.append(k)
        motion[k] = state[[AT.vx_mps, AT.vy_mps, AT.yaw_rate_radps]]
        write_outputs(state, control, record, outputs[k])
        if k == n - 1:
            break
        drive_rpm = float(state[AT.engine_radps]) * 30.0 / pi
        throttle, brake_n = follower.pedals(k, float(rate_mps2[k]), drive_rpm)
        control = ControlInput(throttle, brake_n, float(steer_rad[k]))
        advance(state, control, record, len(steps), STEP_S, steps)
        rate_mps2[k + 1] = (float(state[AT.vx_mps]) - speed_mps[k]) / PERIOD_S
        _add_speed(state, float(speed_mps[k + 1] - state[AT.vx_mps]), parameters)
    return _Drive(motion, outputs, rate_mps2, starts)


def _recorded(recording: Recording, name: str) -> Array:
    """(n,) the recorded signal; zeros if there is none."""
    found = (one.values for one in recording.signals if one.name == name)
    return next(found, np.zeros(len(recording.time_s)))


def _add_speed(state: Array, more_mps: float, parameters: Parameters) -> None:
    """Change the speed in place; the wheels turn faster by as much, so their slips remain."""
    state[AT.vx_mps] += more_mps
    for wheel in range(N_WHEELS):
        state[AT.spin_radps + wheel] += more_mps / parameters.tyre.rolling_radius_m
