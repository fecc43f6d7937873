"""Test sets with noise on what a model hears: the first state, and the states of the past.

The states that a prediction is compared with, the inputs and the curvature have none. The draws are
seeded, the same for all models, and those of another level are the same times its factor.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from offline.data.sensor_noise import STANDARD_DEVIATIONS, noise_matrix
from offline.data.signals import Roles, past_names
from offline.evaluation.test_sets import LIBRARY, NOISE, TestSet
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.schema import Schema

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
    drawn = level * np.stack(
        [rng.normal(size=(len(x), 1 + past.shape[1])) for _ in STANDARD_DEVIATIONS], axis=-1
    )
    at_start, before = x.copy(), past.copy()
    at_start[:, 0] += drawn[:, -1] @ noise_matrix(schema.state_names, schema.dt_s)
    before += drawn[:, :-1] @ noise_matrix(heard, schema.dt_s)
    listed = ", ".join(noisy)
    return replace(
        library,
        name=set_name(level),
        description=f"{LIBRARY} with {level:g} times the measurement noise on {listed}",
        trajectories=library.trajectories._replace(x=at_start, past=before),
    )
