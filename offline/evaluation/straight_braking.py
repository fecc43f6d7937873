"""Straight stops of the simulated car with the full brake, as a test set.

The wheel stays straight, the pedal follows 0 to 150 N at its rate. In four of the five windows of a
drive the brake begins within the window, in the last it acts from the start. The road is straight;
each window has its own lateral and heading error, as the slices of the data sets.
"""

from hashlib import sha256

import numpy as np

from offline.config import PAST_STEPS, STEPS
from offline.data.generate import FIRST_EPSI_RAD, FIRST_EY_M, SLICES, Episode, assemble
from offline.data.recording import cut
from offline.data.signals import VEHICLE_ROLES
from offline.evaluation.test_sets import BRAKING, TestSet
from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.schema import VEHICLE
from rt_controller.contract.signals import InputColumn
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.frenet import integrate_poses
from sim_bridge.plant.integrate import STEP_S, STEPS_PER_PERIOD, settle, simulate
from sim_bridge.plant.parameters import default_car

FIRST_SPEEDS_KMH = tuple(range(90, 131, 2))
"""the car still moves at the end of each drive"""
PRESSED_AT_S = (1.6, 1.2, 0.8, 0.4, -0.4)
"""beginning of the brake after the beginning of each of the five windows"""
SEED = 46_050


def straight_braking_set() -> TestSet:
    """All windows of all drives; simulated within a second, so they are not kept."""
    pressed = PAST_STEPS + _periods(max(PRESSED_AT_S))
    inputs = np.zeros((pressed + STEPS - _periods(min(PRESSED_AT_S)), 3))
    ramp_n = INPUT_LIMITS.rate_per_s.brake_n * PERIOD_S * np.arange(1, len(inputs) - pressed + 1)
    inputs[pressed:, InputColumn.brake_n] = np.minimum(ramp_n, INPUT_LIMITS.upper.brake_n)
    rng = np.random.default_rng(SEED)
    drives = assemble([_stop(speed / 3.6, inputs, rng) for speed in FIRST_SPEEDS_KMH])
    first = [pressed - _periods(after_s) for after_s in PRESSED_AT_S]
    starts = drives.slices._replace(row=np.add.outer(drives.recording.first, first).ravel())
    trajectories = cut(drives.recording, starts, VEHICLE, VEHICLE_ROLES)
    numbers = b"".join(array.tobytes() for array in trajectories if array is not None)
    description = (
        f"{len(FIRST_SPEEDS_KMH)} straight stops from {FIRST_SPEEDS_KMH[0]} to "
        f"{FIRST_SPEEDS_KMH[-1]} km/h with {INPUT_LIMITS.upper.brake_n:g} N"
    )
    digest = sha256(numbers).hexdigest()
    return TestSet(BRAKING, description, trajectories, np.zeros(len(starts.row)), digest)


def _stop(first_speed_mps: float, inputs: Array, rng: np.random.Generator) -> Episode:
    car = default_car()
    motion, _ = simulate(settle(first_speed_mps, car), inputs, car, STEPS_PER_PERIOD, STEP_S)
    pose = integrate_poses(motion, 0.0, 0.0, 0.0, STEPS_PER_PERIOD, STEP_S)
    errors = rng.uniform(-1.0, 1.0, (SLICES, 2)) * (FIRST_EY_M, FIRST_EPSI_RAD)
    return Episode(motion[::STEPS_PER_PERIOD], pose, inputs, 0.0, errors, 0)


def _periods(duration_s: float) -> int:
    return round(duration_s / PERIOD_S)
