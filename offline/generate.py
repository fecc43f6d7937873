"""Episodes of the simulated car: long drives that windows are cut from.

An episode is 10.5 s of driving on a plane, logged with its poses: half a second of past, then
401 instants, of which five slices share their boundaries: 81 states and 80 inputs each. The road
is laid under each slice with lateral and heading error of its own, one period before it starts,
so that the backward progress of its first state is the same kind of number as all others.

Every episode has a random stream of its own, spawned from the seed: the data do not depend on how
many processes made them.

Paper: section III-A, data acquisition.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from math import radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.excitation import Recipe, draw_inputs
from offline.lengths import PAST_STEPS, STEPS
from offline.parallel import in_order
from offline.recording import Recording, Starts
from offline.road_frame import Anchor
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.frenet import roll_out
from sim_bridge.plant.integrate import STEP_S, STEPS_PER_PERIOD, settle, simulate
from sim_bridge.plant.monitor import Monitor
from sim_bridge.plant.parameters import (
    C_CLASS_150KW_AWD,
    Parameters,
    with_mass_factor,
    with_road_friction,
)

Array = NDArray[np.float64]

SLICES = 5
EPISODE_STEPS = PAST_STEPS + SLICES * STEPS
CHUNK_EPISODES = 20

FIRST_EY_M = 2.0
FIRST_EPSI_RAD = radians(10.0)
LOWEST_SPEED_MPS = 10.0 / 3.6
LARGEST_SIDESLIP_RAD = radians(15.0)
LARGEST_ROLL_RAD = radians(15.0)


class Episode(NamedTuple):
    """One drive that was kept, and the tries it took."""

    motion: Array
    """(T, 3) v_x, v_y, yaw rate at the periods' ends, the start included"""
    pose: Array
    """(T, 3) X_m, Y_m, yaw_rad"""
    inputs: Array
    """(T - 1, 3) as `ControlInput`"""
    curvature_per_m: float
    first_errors: Array
    """(5, 2) e_y and e_psi one period before each slice"""
    rejected: int


@dataclass(frozen=True, slots=True)
class Generated:
    """The drives of a data set, its slices, and how many drives were thrown away on the way."""

    recording: Recording
    slices: Starts
    rejected: int


def generate(
    recipe: Recipe,
    episodes: int,
    seed: int,
    jobs: int | None = -1,
    on_progress: Callable[[int], None] = lambda done: None,
) -> Generated:
    """`episodes` episodes, in order, made by `jobs` processes (-1: one per core).

    None leaves the number, and where they run, to the active `offline.backend.Backend`.
    `on_progress` hears how many more episodes are done.
    """
    seeds = np.random.SeedSequence(seed).spawn(episodes)
    chunks = range(0, episodes, CHUNK_EPISODES)
    tasks = [(recipe, seeds[first : first + CHUNK_EPISODES]) for first in chunks]
    made: list[Episode] = []
    for chunk in in_order(_make_chunk, tasks, jobs):
        made += chunk
        on_progress(len(chunk))
    return assemble(made)


def make_episode(recipe: Recipe, seed: np.random.SeedSequence) -> Episode:
    """One episode; rejected tries are drawn again from the same stream."""
    rng = np.random.default_rng(seed)
    rejected = 0
    while (episode := _try_episode(rng, recipe, rejected)) is None:
        rejected += 1
    return episode


def assemble(episodes: list[Episode]) -> Generated:
    """Episodes of equal length as one recording, with five slices each."""
    count, length = len(episodes), len(episodes[0].motion)
    first = length * np.arange(count, dtype=np.int64)
    u = np.stack([np.vstack([e.inputs, e.inputs[-1:]]) for e in episodes])
    curvature = np.array([e.curvature_per_m for e in episodes])
    recording = Recording(
        x=np.concatenate([e.motion for e in episodes]).astype(np.float32),
        u=u.reshape(-1, u.shape[-1]).astype(np.float32),
        w=np.repeat(curvature, length)[:, None].astype(np.float32),
        pose=np.concatenate([e.pose for e in episodes]),
        first=first,
    )
    errors = np.concatenate([e.first_errors for e in episodes])
    slices = Starts(
        row=np.add.outer(first, PAST_STEPS + STEPS * np.arange(SLICES)).ravel(),
        episode=np.repeat(np.arange(count, dtype=np.int32), SLICES),
        anchor=Anchor(np.repeat(curvature, SLICES), errors[:, 0].copy(), errors[:, 1].copy()),
    )
    return Generated(recording, slices, sum(e.rejected for e in episodes))


def plant_fingerprint() -> str:
    """Hash of how the simulated car answers one fixed manoeuvre, and of how it is driven.

    It changes when the physics, the parameters or the drives do, not when their code is merely
    rewritten, so a stored data set is never mistaken for one of another car or driver. Five digits
    are kept: less than any change of model would leave, more than two compilers would differ by.
    """
    k = np.arange(round(3.0 / PERIOD_S))
    inputs = np.zeros((len(k), 3))
    inputs[:, 0] = np.where(k < 40, 0.6, 0.0)
    inputs[:, 1] = np.where(k >= 60, 60.0, 0.0)
    inputs[:, 2] = INPUT_LIMITS.upper.steer_rad * np.sin(2 * np.pi * 0.5 * k * PERIOD_S)
    motion, _ = _drive(20.0, inputs)
    drawn = make_episode(Recipe(), np.random.SeedSequence(0))
    limits = (LOWEST_SPEED_MPS, LARGEST_SIDESLIP_RAD, LARGEST_ROLL_RAD, FIRST_EY_M, FIRST_EPSI_RAD)
    numbers = (motion[::200], drawn.motion[::20], drawn.inputs, drawn.first_errors, limits)
    values = np.concatenate([np.ravel(each) for each in numbers])
    digits = ",".join(f"{value:.4e}" for value in values)
    return hashlib.sha256(digits.encode()).hexdigest()


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


def _drive(
    first_speed_mps: float, inputs: Array, car: Parameters = C_CLASS_150KW_AWD
) -> tuple[Array, Array]:
    """Motion (periods * 25 + 1, 3) and monitor (periods + 1, columns) of a settled car."""
    return simulate(settle(first_speed_mps, car), inputs, car, STEPS_PER_PERIOD, STEP_S)


def _try_episode(rng: np.random.Generator, recipe: Recipe, rejected: int) -> Episode | None:
    curvature_per_m = float(rng.choice(recipe.curvatures_per_m))
    first_speed_mps = float(rng.uniform(*recipe.first_speed_mps))
    inputs = draw_inputs(rng, recipe, EPISODE_STEPS)
    first_errors = rng.uniform(-1.0, 1.0, (SLICES, 2)) * (FIRST_EY_M, FIRST_EPSI_RAD)
    motion, monitor = _drive(first_speed_mps, inputs, _draw_car(rng, recipe))
    if not is_kept(motion, monitor):
        return None
    # On a straight road along X, path and plane are the same thing.
    pose = roll_out(motion, 0.0, 0.0, 0.0, STEPS_PER_PERIOD, STEP_S)
    sampled = motion[::STEPS_PER_PERIOD]
    return Episode(sampled, pose, inputs, curvature_per_m, first_errors, rejected)


def _draw_car(rng: np.random.Generator, recipe: Recipe) -> Parameters:
    car = C_CLASS_150KW_AWD
    if recipe.road_friction is not None:
        car = with_road_friction(car, float(rng.uniform(*recipe.road_friction)))
    if recipe.mass_factor is not None:
        car = with_mass_factor(car, float(rng.uniform(*recipe.mass_factor)))
    return car


def _make_chunk(recipe: Recipe, seeds: list[np.random.SeedSequence]) -> list[Episode]:
    return [make_episode(recipe, seed) for seed in seeds]
