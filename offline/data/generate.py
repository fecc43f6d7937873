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
from math import degrees, radians
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.config import PAST_STEPS, PRESETS, STEPS
from offline.data.dataset import Dataset, cache_folder, save_dataset, split_episodes, writable
from offline.data.manifest import Roads, Simulated
from offline.data.recipe import CONDITIONS, Conditions, Recipe, draw_conditions, draw_inputs
from offline.data.recording import Anchor, Recording, Starts
from offline.data.signals import VEHICLE_ROLES, Array32
from offline.data.variation import VARIED, Variation
from rt_controller.contract.arrays import Array
from rt_controller.contract.car import DEFAULT_CAR, Car
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.limits import INPUT_LIMITS, SteeringGeometry
from rt_controller.contract.signals import VEHICLE, InputColumn, StateColumn
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.campaign import THIS_MACHINE, Backend, run_campaign
from sim_bridge.frenet import integrate_poses
from sim_bridge.plant.library import STEP_S, STEPS_PER_PERIOD, settle, simulate
from sim_bridge.plant.parameters import default_car
from sim_bridge.plant.protocol import PlantOutputs

SLICES = 5
MOST_REJECTED = 500
"""drives in a row under the same conditions"""
EPISODE_STEPS = PAST_STEPS + SLICES * STEPS
CHUNK_EPISODES = 20

_ALL_CHANGING = {"nominal_share": 0.0, "changing_share": 1.0}

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
    conditions: Array | None = None
    """(T - 1, q) as `CONDITIONS`; None: nothing varies"""


class Generated(NamedTuple):
    """The episodes of a data set, their slices, and the number of rejected episodes."""

    recording: Recording
    slices: Starts
    rejected: int


def steering_geometry() -> SteeringGeometry:
    """Of the car that drives the episodes."""
    body, steering = default_car().body, default_car().steering
    return SteeringGeometry(
        wheelbase_m=body.wheelbase_m,
        rear_axle_m=body.rear_axle_m,
        steering_ratio=steering.ratio,
        lock_rad=steering.lock_rad,
    )


def generate(
    recipe: Recipe,
    episodes: int,
    seed: int,
    backend: Backend = THIS_MACHINE,
    on_progress: Callable[[int], None] = lambda done: None,
) -> Generated:
    """`episodes` episodes; `on_progress` is called with the number of those made so far."""
    seeds = np.random.SeedSequence(seed).spawn(episodes)
    firsts = range(0, episodes, CHUNK_EPISODES)
    tasks = [(str(k), (recipe, seeds[k : k + CHUNK_EPISODES])) for k in firsts]
    made: list[Episode] = []
    on_progress(0)
    for _, chunk in run_campaign(_make_chunk, tasks, backend, in_order=True):
        made += chunk
        on_progress(len(made))
    return assemble(made)


def make_episode(recipe: Recipe, seed: np.random.SeedSequence) -> Episode:
    """One episode; after a rejection the next is drawn from the same stream.

    The conditions stay: otherwise drives on slippery roads, which are rejected more often, would
    be rarer than the recipe says.

    Raises:
        DatasetError: `MOST_REJECTED` drives in a row were rejected.
    """
    rng = np.random.default_rng(seed)
    conditions = None
    if recipe.variation is not None:
        conditions = draw_conditions(rng, recipe.variation, EPISODE_STEPS)
    for rejected in range(MOST_REJECTED):
        episode = _try_episode(rng, recipe, conditions, rejected)
        if episode is not None:
            return episode
    found = ""
    if conditions is not None:
        first = zip(CONDITIONS, conditions.rows[0], strict=True)
        found = f" under {', '.join(f'{name} {value:.3g}' for name, value in first)}"
    raise DatasetError(
        f"expected an episode in which the car stays above {3.6 * LOWEST_SPEED_MPS:.0f} km/h and "
        f"below {degrees(LARGEST_SIDESLIP_RAD):.0f} deg of sideslip and roll, found "
        f"{MOST_REJECTED} drawn without one{found}. Choose ranges with more friction, less wind or "
        f"smaller slopes."
    )


def assemble(episodes: list[Episode]) -> Generated:
    """Episodes of equal length as one recording, with five slices each."""
    count, length = len(episodes), len(episodes[0].motion)
    first = length * np.arange(count, dtype=np.int64)
    conditions = [e.conditions for e in episodes if e.conditions is not None]
    curvature = np.array([float(e.curvature_per_m) for e in episodes])
    recording = Recording(
        x=np.concatenate([e.motion for e in episodes]).astype(np.float32),
        u=_concatenate_held([e.inputs for e in episodes]),
        w=np.repeat(curvature, length)[:, None].astype(np.float32),
        pose=np.concatenate([e.pose for e in episodes]),
        first=first,
        conditions=_concatenate_held(conditions) if conditions else None,
    )
    errors = np.concatenate([e.first_errors for e in episodes])
    slices = Starts(
        row=np.add.outer(first, PAST_STEPS + STEPS * np.arange(SLICES)).ravel(),
        episode=np.repeat(np.arange(count, dtype=np.int32), SLICES),
        anchor=Anchor(np.repeat(curvature, SLICES), errors[:, 0].copy(), errors[:, 1].copy()),
    )
    return Generated(recording, slices, sum(e.rejected for e in episodes))


def plant_fingerprint(variation: Variation | None = None) -> str:
    """Digest of the car's response to one fixed manoeuvre, and of one random episode.

    If conditions vary, of one episode in which all of them change too. It changes with the physics,
    the parameters and the recipe, but not if their code is merely rewritten, so a cached data set
    is not mistaken for one of another car. Values are rounded to five digits, above the differences
    between compilers.
    """
    k = np.arange(round(3.0 / PERIOD_S))
    inputs = np.zeros((len(k), 3))
    inputs[:, InputColumn.throttle] = np.where(k < 40, 0.6, 0.0)
    inputs[:, InputColumn.brake_n] = np.where(k >= 60, 60.0, 0.0)
    inputs[:, InputColumn.steer_rad] = INPUT_LIMITS.upper.steer_rad * np.sin(
        2 * np.pi * 0.5 * k * PERIOD_S
    )
    car = default_car()
    motion, _ = simulate(settle(20.0, car), inputs, car, STEPS_PER_PERIOD, STEP_S)
    drawn = make_episode(Recipe(), np.random.SeedSequence(0))
    limits = (LOWEST_SPEED_MPS, LARGEST_SIDESLIP_RAD, LARGEST_ROLL_RAD, FIRST_EY_M, FIRST_EPSI_RAD)
    numbers: list[Any] = [motion[::200], drawn.motion[::20], drawn.inputs]
    numbers += [drawn.first_errors, limits]
    if variation is not None:
        recipe = Recipe(variation=VARIED.model_copy(update=_ALL_CHANGING))
        varied = make_episode(recipe, np.random.SeedSequence(0))
        numbers += [varied.motion[::20], varied.conditions]
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


def _try_episode(
    rng: np.random.Generator, recipe: Recipe, conditions: Conditions | None, rejected: int
) -> Episode | None:
    curvature_per_m = float(rng.choice(recipe.curvatures_per_m))
    first_speed_mps = float(rng.uniform(*recipe.first_speed_mps))
    lateral_mps2 = DEFAULT_CAR.plan_lateral_mps2
    most_rad = steering_geometry().largest_wheel_rad(first_speed_mps, lateral_mps2)
    inputs = draw_inputs(rng, recipe, EPISODE_STEPS, min(most_rad, recipe.largest_steer_rad))
    first_errors = rng.uniform(-1.0, 1.0, (SLICES, 2)) * (FIRST_EY_M, FIRST_EPSI_RAD)
    car, roads, rows = conditions or (default_car(), None, None)
    start = settle(first_speed_mps, car)
    motion, outputs = simulate(start, inputs, car, STEPS_PER_PERIOD, STEP_S, roads)
    if not is_kept(motion, outputs):
        return None
    # On a straight road along X, path coordinates are plane coordinates.
    pose = integrate_poses(motion, 0.0, 0.0, 0.0, STEPS_PER_PERIOD, STEP_S)
    sampled = motion[::STEPS_PER_PERIOD]
    return Episode(sampled, pose, inputs, curvature_per_m, first_errors, rejected, rows)


def _concatenate_held(episodes: list[Array]) -> Array32:
    """Values (T - 1, m) held over the periods of each episode, with the last one repeated."""
    return np.concatenate([np.vstack([held, held[-1:]]) for held in episodes]).astype(np.float32)


def _make_chunk(recipe: Recipe, seeds: list[np.random.SeedSequence]) -> list[Episode]:
    return [make_episode(recipe, seed) for seed in seeds]


def simulated_origin(recipe: Recipe, episodes: int, seed: int) -> Simulated:
    """The origin of a data set made now; compiles the vehicle model."""
    return Simulated(recipe, episodes, seed, plant_fingerprint(recipe.variation))


def full_folder() -> Path:
    """The folder of the paper's data set, of the current recipe and car."""
    paper = PRESETS["paper"]
    return cache_folder(simulated_origin(Recipe(), paper.episodes, paper.data_seed))


def make_dataset(
    folder: Path,
    origin: Simulated,
    part: NDArray[np.int8] | None = None,
    backend: Backend = THIS_MACHINE,
    on_progress: Callable[[int], None] = lambda done: None,
) -> Dataset:
    """A new data set of simulated episodes in that folder.

    Args:
        folder: where it is written.
        origin: what it is made from.
        part: (E,) part of each episode, as in `Dataset`; None: drawn at random.
        backend: where the episodes are made.
        on_progress: called with the number of episodes made so far.

    Raises:
        DatasetError: the folder cannot be made (before the simulation), or has no room.
    """
    recipe, episodes, seed = origin.recipe, origin.episodes, origin.seed
    with writable(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):  # refused now, and not after the simulation
            pass
    made = generate(recipe, episodes, seed, backend, on_progress)
    return save_dataset(
        folder,
        made.recording,
        made.slices,
        split_episodes(episodes, seed) if part is None else part,
        schema=VEHICLE,
        roles=VEHICLE_ROLES,
        roads=Roads(recipe.curvatures_per_m, FIRST_EY_M, FIRST_EPSI_RAD),
        origin=origin,
        car=Car(*steering_geometry()),
        conditions=() if made.recording.conditions is None else CONDITIONS,
        rejected=made.rejected,
    )
