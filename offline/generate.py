"""Episodes of the simulated car, cut into the trajectories that the model learns from.

An episode is 10 s of driving, logged at 401 instants after one period of warm-up, and cut into
five slices that share their boundary instants: 81 states and 80 inputs each. Lateral and heading
error are drawn anew for each slice, one period before it starts, so that the backward progress
of its first state is the same kind of number as all others.

Every episode has a random stream of its own, spawned from the seed: the data do not depend on how
many processes made them.

Paper: section III-A, data acquisition.
"""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import radians

import joblib
import numpy as np
from numpy.typing import NDArray

from offline.dataset import Trajectories
from offline.excitation import Recipe, draw_inputs
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import VehicleState
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.frenet import roll_out
from sim_bridge.plant.integrate import STEP_S, STEPS_PER_PERIOD, settle, simulate
from sim_bridge.plant.monitor import Monitor
from sim_bridge.plant.parameters import C_CLASS_150KW_AWD

Array = NDArray[np.float64]

SLICES = 5
SLICE_STEPS = 80
EPISODE_STEPS = SLICES * SLICE_STEPS
CHUNK_EPISODES = 20

FIRST_EY_M = 2.0
FIRST_EPSI_RAD = radians(10.0)
LOWEST_SPEED_MPS = 10.0 / 3.6
LARGEST_SIDESLIP_RAD = radians(15.0)
LARGEST_ROLL_RAD = radians(15.0)


@dataclass(frozen=True, slots=True)
class Generated:
    """The trajectories of a data set and how many episodes were thrown away on the way."""

    trajectories: Trajectories
    rejected: int


def generate(
    recipe: Recipe,
    episodes: int,
    seed: int,
    jobs: int = -1,
    on_progress: Callable[[int], None] = lambda done: None,
) -> Generated:
    """All slices of `episodes` episodes, in order, made by `jobs` processes (-1: one per core).

    `on_progress` hears how many more episodes are done.
    """
    seeds = np.random.SeedSequence(seed).spawn(episodes)
    chunks = range(0, episodes, CHUNK_EPISODES)
    parallel = joblib.Parallel(n_jobs=jobs, return_as="generator")
    results: Iterator[Generated] = parallel(
        joblib.delayed(_generate_chunk)(recipe, first, seeds[first : first + CHUNK_EPISODES])
        for first in chunks
    )
    made: list[Generated] = []
    for result in results:
        made.append(result)
        on_progress(len(result.trajectories.kappa) // SLICES)
    return _concatenate(made)


def make_episode(recipe: Recipe, episode: int, seed: np.random.SeedSequence) -> Generated:
    """The slices of one episode; rejected tries are drawn again from the same stream."""
    rng = np.random.default_rng(seed)
    rejected = 0
    while (trajectories := _try_episode(rng, recipe, episode)) is None:
        rejected += 1
    return Generated(trajectories, rejected)


def plant_fingerprint() -> str:
    """Hash of how the simulated car answers one fixed manoeuvre.

    It changes when the physics or the parameters do, not when their code is merely rewritten, so
    a stored data set is never mistaken for one of another car. Five digits are kept: less than
    any change of model would leave, more than two compilers would differ by.
    """
    k = np.arange(round(3.0 / PERIOD_S))
    inputs = np.zeros((len(k), 3))
    inputs[:, 0] = np.where(k < 40, 0.6, 0.0)
    inputs[:, 1] = np.where(k >= 60, 60.0, 0.0)
    inputs[:, 2] = INPUT_LIMITS.upper.steer_rad * np.sin(2 * np.pi * 0.5 * k * PERIOD_S)
    motion, _ = _drive(20.0, inputs)
    digits = ",".join(f"{value:.4e}" for value in np.asarray(motion)[::200].ravel())
    return hashlib.sha256(digits.encode()).hexdigest()


def slice_episode(
    motion: Array, inputs: Array, curvature_per_m: float, first_errors: Array
) -> tuple[Array, Array]:
    """States (5, 81, 6) and inputs (5, 80, 3) of an episode.

    motion (401 * 25 + 1, 3) holds v_x, v_y and yaw rate on the integration grid, the first period
    being warm-up, inputs (401, 3) what was held in each period, first_errors (5, 2) the lateral
    and heading error one period before each slice.
    """
    x = np.empty((SLICES, SLICE_STEPS + 1, len(VehicleState._fields)))
    u = np.empty((SLICES, SLICE_STEPS, inputs.shape[1]))
    for q in range(SLICES):
        before = q * SLICE_STEPS
        window = motion[
            before * STEPS_PER_PERIOD : (before + SLICE_STEPS + 1) * STEPS_PER_PERIOD + 1
        ]
        path = roll_out(
            np.ascontiguousarray(window),
            curvature_per_m,
            float(first_errors[q, 0]),
            float(first_errors[q, 1]),
            STEPS_PER_PERIOD,
            STEP_S,
        )
        x[q, :, :3] = window[STEPS_PER_PERIOD::STEPS_PER_PERIOD]
        x[q, :, 3] = np.diff(path[:, 0])
        x[q, :, 4:] = path[1:, 1:]
        u[q] = inputs[before + 1 : before + 1 + SLICE_STEPS]
    return x, u


def is_kept(motion: Array, monitor: Array) -> bool:
    """Whether an episode stayed where the model is meant to hold: rolling, gripping, upright."""
    sideslip_rad = monitor[:, Monitor._fields.index("sideslip_rad")]
    roll_rad = monitor[:, Monitor._fields.index("roll_rad")]
    return bool(
        np.all(np.isfinite(motion))
        and np.all(motion[:, 0] >= LOWEST_SPEED_MPS)
        and np.all(np.abs(sideslip_rad) <= LARGEST_SIDESLIP_RAD)
        and np.all(np.abs(roll_rad) <= LARGEST_ROLL_RAD)
    )


def _drive(first_speed_mps: float, inputs: Array) -> tuple[Array, Array]:
    """Motion (periods * 25 + 1, 3) and monitor (periods + 1, columns) of a settled car."""
    car = C_CLASS_150KW_AWD
    return simulate(settle(first_speed_mps, car), inputs, car, STEPS_PER_PERIOD, STEP_S)


def _try_episode(rng: np.random.Generator, recipe: Recipe, episode: int) -> Trajectories | None:
    curvature_per_m = float(rng.choice(recipe.curvatures_per_m))
    first_speed_mps = float(rng.uniform(*recipe.first_speed_mps))
    inputs = draw_inputs(rng, recipe, EPISODE_STEPS + 1)
    first_errors = rng.uniform(-1.0, 1.0, (SLICES, 2)) * (FIRST_EY_M, FIRST_EPSI_RAD)
    motion, monitor = _drive(first_speed_mps, inputs)
    if not is_kept(motion, monitor):
        return None
    x, u = slice_episode(motion, inputs, curvature_per_m, first_errors)
    if not np.all(np.isfinite(x)):
        return None
    return Trajectories(
        x=x.astype(np.float32),
        u=u.astype(np.float32),
        kappa=np.full(SLICES, curvature_per_m, dtype=np.float32),
        episode=np.full(SLICES, episode, dtype=np.int32),
    )


def _generate_chunk(recipe: Recipe, first: int, seeds: list[np.random.SeedSequence]) -> Generated:
    return _concatenate([make_episode(recipe, first + i, seed) for i, seed in enumerate(seeds)])


def _concatenate(parts: list[Generated]) -> Generated:
    trajectories = [part.trajectories for part in parts]
    return Generated(
        Trajectories(
            x=np.concatenate([slices.x for slices in trajectories]),
            u=np.concatenate([slices.u for slices in trajectories]),
            kappa=np.concatenate([slices.kappa for slices in trajectories]),
            episode=np.concatenate([slices.episode for slices in trajectories]),
        ),
        sum(part.rejected for part in parts),
    )
