"""Episodes of the simulated car, from which windows are cut.

An episode is 10.5 s on a plane, recorded with poses: 0.5 s of history, then five slices of 2 s
that share their boundary states. Each slice gets a road with a random lateral and heading error,
placed one period before its first state, so that the progress of that state is defined.

Every episode has its own random stream, spawned from the seed, so that the data do not depend on
the number of processes.

Paper: section III-A, data acquisition.
"""

import hashlib
from collections.abc import Callable
from math import radians
from typing import NamedTuple

import numpy as np

from offline.config import PAST_STEPS, STEPS
from offline.data.excitation import Recipe, draw_inputs
from offline.data.recording import Recording, Starts
from offline.data.road_frame import Anchor
from offline.data.tasks import run_tasks
from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import InputColumn, StateColumn
from rt_controller.contract.steering_geometry import SteeringGeometry
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.frenet import integrate_poses
from sim_bridge.plant.integrate import STEP_S, STEPS_PER_PERIOD, settle, simulate
from sim_bridge.plant.parameters import (
    Parameters,
    default_car,
    with_mass_factor,
    with_road_friction,
)
from sim_bridge.plant.protocol import PlantOutputs

SLICES = 5
EPISODE_STEPS = PAST_STEPS + SLICES * STEPS
CHUNK_EPISODES = 20

FIRST_EY_M = 2.0
FIRST_EPSI_RAD = radians(10.0)
LOWEST_SPEED_MPS = 10.0 / 3.6
LARGEST_SIDESLIP_RAD = radians(15.0)
LARGEST_ROLL_RAD = radians(15.0)


class Episode(NamedTuple):
    """One episode, and how many were rejected before it."""

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


class Generated(NamedTuple):
    """The episodes of a data set, their slices, and the number of rejected episodes."""

    recording: Recording
    slices: Starts
    rejected: int


def steering_geometry() -> SteeringGeometry:
    """Of the car that drives the episodes."""
    body, steering = default_car().body, default_car().steering
    return SteeringGeometry(
        wheelbase_m=body.front_axle_m + body.rear_axle_m,
        rear_axle_m=body.rear_axle_m,
        steering_ratio=steering.ratio,
    )


def generate(
    recipe: Recipe,
    episodes: int,
    seed: int,
    jobs: int | None = -1,
    on_progress: Callable[[int], None] = lambda done: None,
) -> Generated:
    """`episodes` episodes, in order, made by `jobs` processes (-1: one per core).

    With `jobs` None, the active joblib backend determines the number and place of the workers.
    `on_progress` is called with the number of episodes made so far.
    """
    seeds = np.random.SeedSequence(seed).spawn(episodes)
    chunks = range(0, episodes, CHUNK_EPISODES)
    tasks = [(recipe, seeds[first : first + CHUNK_EPISODES]) for first in chunks]
    made: dict[int, list[Episode]] = {}
    for index, chunk in run_tasks(_make_chunk, tasks, jobs):
        made[index] = chunk
        on_progress(sum(map(len, made.values())))
    return assemble([episode for _, chunk in sorted(made.items()) for episode in chunk])


def make_episode(recipe: Recipe, seed: np.random.SeedSequence) -> Episode:
    """One episode; after a rejection the next is drawn from the same stream."""
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
    """Digest of the car's response to one fixed manoeuvre, and of one random episode.

    It changes with the physics, the parameters and the recipe, but not if their code is merely
    rewritten, so a cached data set is not mistaken for one of another car. Values are rounded to
    five digits, above the differences between compilers.
    """
    k = np.arange(round(3.0 / PERIOD_S))
    inputs = np.zeros((len(k), 3))
    inputs[:, InputColumn.throttle] = np.where(k < 40, 0.6, 0.0)
    inputs[:, InputColumn.brake_n] = np.where(k >= 60, 60.0, 0.0)
    inputs[:, InputColumn.steer_rad] = INPUT_LIMITS.upper.steer_rad * np.sin(
        2 * np.pi * 0.5 * k * PERIOD_S
    )
    motion, _ = _drive(20.0, inputs, default_car())
    drawn = make_episode(Recipe(), np.random.SeedSequence(0))
    limits = (LOWEST_SPEED_MPS, LARGEST_SIDESLIP_RAD, LARGEST_ROLL_RAD, FIRST_EY_M, FIRST_EPSI_RAD)
    numbers = (motion[::200], drawn.motion[::20], drawn.inputs, drawn.first_errors, limits)
    values = np.concatenate([np.ravel(each) for each in numbers])
    text = ",".join(f"{value:.4e}" for value in values)
    return hashlib.sha256(text.encode()).hexdigest()


def is_kept(motion: Array, outputs: Array) -> bool:
    """True if the car kept moving, did not skid, and did not roll over."""
    sideslip_rad = outputs[:, PlantOutputs._fields.index("sideslip_rad")]
    roll_rad = outputs[:, PlantOutputs._fields.index("roll_rad")]
    return bool(
        np.all(np.isfinite(motion))
        and np.all(motion[:, StateColumn.vx_mps] >= LOWEST_SPEED_MPS)
        and np.all(np.abs(sideslip_rad) <= LARGEST_SIDESLIP_RAD)
        and np.all(np.abs(roll_rad) <= LARGEST_ROLL_RAD)
    )


def _drive(first_speed_mps: float, inputs: Array, car: Parameters) -> tuple[Array, Array]:
    """Motion (periods * STEPS_PER_PERIOD + 1, 3) and outputs (periods + 1, columns)."""
    return simulate(settle(first_speed_mps, car), inputs, car, STEPS_PER_PERIOD, STEP_S)


def _try_episode(rng: np.random.Generator, recipe: Recipe, rejected: int) -> Episode | None:
    curvature_per_m = float(rng.choice(recipe.curvatures_per_m))
    first_speed_mps = float(rng.uniform(*recipe.first_speed_mps))
    inputs = draw_inputs(rng, recipe, EPISODE_STEPS)
    first_errors = rng.uniform(-1.0, 1.0, (SLICES, 2)) * (FIRST_EY_M, FIRST_EPSI_RAD)
    motion, outputs = _drive(first_speed_mps, inputs, _draw_car(rng, recipe))
    if not is_kept(motion, outputs):
        return None
    # On a straight road along X, path coordinates are plane coordinates.
    pose = integrate_poses(motion, 0.0, 0.0, 0.0, STEPS_PER_PERIOD, STEP_S)
    sampled = motion[::STEPS_PER_PERIOD]
    return Episode(sampled, pose, inputs, curvature_per_m, first_errors, rejected)


def _draw_car(rng: np.random.Generator, recipe: Recipe) -> Parameters:
    car = default_car()
    if recipe.road_friction is not None:
        car = with_road_friction(car, float(rng.uniform(*recipe.road_friction)))
    if recipe.mass_factor is not None:
        car = with_mass_factor(car, float(rng.uniform(*recipe.mass_factor)))
    return car


def _make_chunk(recipe: Recipe, seeds: list[np.random.SeedSequence]) -> list[Episode]:
    return [make_episode(recipe, seed) for seed in seeds]
