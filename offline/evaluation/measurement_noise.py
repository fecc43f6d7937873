"""Test sets with noise on what a model hears: the first state, and the states of the past.

The states that a prediction is compared with, the inputs and the curvature have none. The draws are
seeded, the same for all models, and those of another level are the same times its factor.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from offline.data.signals import Roles, past_names
from offline.evaluation.test_sets import LIBRARY, NOISE, TestSet
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.schema import Schema

STANDARD_DEVIATIONS = {
    "vx_mps": 0.03,
    "vy_mps": 0.03,
    "yaw_rate_radps": float(np.radians(0.1)),
    "ey_m": 0.02,
    "epsi_rad": float(np.radians(0.1)),
}
"""by state, at level 1; normally distributed, independent between signals and instants. Progress
has the noise of the longitudinal speed times the period, from which a car computes it"""

DEFAULT_LEVELS = (1.0, 3.0)
LARGEST_LEVEL = 100.0
SEED = 48


def choose_levels(levels: Sequence[float] | None) -> tuple[float, ...]:
    """These levels in ascending order, each once; `DEFAULT_LEVELS` if there are none.

    Raises:
        ConfigError: a level is not a number between 0 and 100.
    """
    for level in levels or ():
        if not 0.0 < level <= LARGEST_LEVEL:
            raise ConfigError(
                f"--noise: expected factors above 0 and up to {LARGEST_LEVEL:g}, 1 for a standard "
                f"deviation of {STANDARD_DEVIATIONS['vx_mps']:g} m/s, found {level:g}."
            )
    return tuple(sorted(set(levels or DEFAULT_LEVELS)))


def set_name(level: float) -> str:
    """Name of the test set with that noise: "noise-3"."""
    return f"{NOISE}-{level:g}"


def noisy_set(library: TestSet, level: float, schema: Schema, roles: Roles) -> TestSet | None:
    """The library with noise of that level; None if no state has one."""
    heard = past_names(schema, roles)
    noisy = [name for name in schema.state_names if name in STANDARD_DEVIATIONS]
    if not noisy:
        return None
    x, past = library.trajectories.x, library.trajectories.past
    rng = np.random.default_rng(SEED)
    draws = {
        name: level * STANDARD_DEVIATIONS[name] * rng.normal(size=(len(x), 1 + past.shape[1]))
        for name in noisy
    }
    if "vx_mps" in draws:
        draws["ds_m"] = schema.dt_s * draws["vx_mps"]
    at_start, before = x.copy(), past.copy()
    at_start[:, 0] += _columns(schema.state_names, draws)[:, -1]
    before += _columns(heard, draws)[:, :-1]
    listed = ", ".join(noisy)
    return replace(
        library,
        name=set_name(level),
        description=f"{LIBRARY} with {level:g} times the measurement noise on {listed}",
        trajectories=library.trajectories._replace(x=at_start, past=before),
    )


def _columns(names: Sequence[str], draws: dict[str, Array]) -> Array:
    """The draws (N, H+1) of each name as (N, H+1, len(names)); 0 for a name without any."""
    none = np.zeros_like(next(iter(draws.values())))
    return np.stack([draws.get(name, none) for name in names], axis=-1)
