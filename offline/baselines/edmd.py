"""EDMDc: a linear operator in a dictionary that nobody trains, chosen on the validation part.

One search for all of them. The dictionary is the states, rows of the past, functions of states and
curvature, and the constant; how much of each, how wide the functions are and how strong the ridge
is, is whatever predicts the validation part best over two seconds. Without functions the same
search is DMDc with delays; with products of observables and inputs it is bilinear EDMD.

Proctor, Brunton and Kutz (2016) for DMDc; Williams, Kevrekidis and Rowley (2015) and Korda and
Mezic (2018) for EDMD with inputs; Bruder, Fu and Vasudevan (2021) for the bilinear form.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from offline.baselines.functions import Family, Functions, cosines, gaussians, no_functions
from offline.baselines.lifted_fit import (
    Transitions,
    blank_model,
    moments,
    pick_transitions,
    tune,
)
from offline.baselines.lifted_model import LiftedModel
from offline.baselines.monomial_choice import choose_monomials, row_of_power
from offline.baselines.score import tuning_windows
from offline.dataset import Dataset
from offline.lengths import PAST_STEPS
from offline.roles import Roles
from offline.scaling import Scaling, fit_scaling
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.follow import Follow
from rt_controller.contract.schema import Schema

Array = NDArray[np.float64]


class Gains(StrEnum):
    """Which observables the inputs are multiplied by."""

    NONE = "none"
    SPEED = "speed"
    """the first centred state and its powers: for the car, its speed"""
    STATES = "states"
    PRODUCTS = "products"
    """the states and their products of two"""


@dataclass(frozen=True, slots=True)
class EdmdSettings:
    """What is tried; every combination that fits is."""

    family: Family
    observables: tuple[int, ...] = ()
    """sizes of psi; without functions it follows from the past"""
    past_steps: tuple[int, ...] = (0, 2, 4, 8)
    widths: tuple[float, ...] = (1.0,)
    """of the functions, in typical distances (Gaussians) or spreads (cosines)"""
    ridges: tuple[float, ...] = (1e-10, 1e-8, 1e-6, 1e-5, 1e-4, 1e-3)
    gains: tuple[Gains, ...] = (Gains.NONE,)
    follows: tuple[Follow, ...] = (Follow.START,)
    """what the gains may follow; without gains it makes no difference"""
    most_transitions: int = 250_000
    seed: int = 0


def fit_edmd(dataset: Dataset, settings: EdmdSettings) -> LiftedModel:
    """The model of the least validation score among all that the settings allow.

    Raises:
        DatasetError: none of them predicts anything finite.
    """
    schema, roles = dataset.schema, dataset.roles
    train, validation = dataset.select("train"), tuning_windows(dataset)
    scaling = fit_scaling(train, schema, roles)
    best_score, best = np.inf, None
    for past_steps in settings.past_steps:
        data = pick_transitions(train, schema, roles, past_steps, settings.most_transitions)
        for functions in _dictionaries(settings, scaling, data, past_steps):
            for gains in _gain_columns(settings, functions, scaling, past_steps, schema, roles):
                model = blank_model(functions, scaling, past_steps, gains)
                of = moments(model, data)
                score, found = tune(model, of, settings.ridges, settings.follows, validation)
                if score < best_score:
                    best_score, best = score, found
    if best is None:
        raise DatasetError(
            f"expected a dictionary of {settings.family.value} that predicts finite numbers over "
            f"the validation part, found none among {settings.observables or 'the delays'}. "
            f"Leave out this rival, or widen its ridges."
        )
    return best


def _dictionaries(
    settings: EdmdSettings, scaling: Scaling, data: Transitions, past_steps: int
) -> Iterator[Functions]:
    """Every dictionary of these settings with so much past."""
    q = len(scaling.x_scale) + len(scaling.w_scale)
    if settings.family is Family.NONE:
        yield no_functions(q)
        return
    taken = len(scaling.x_scale) + past_steps * len(scaling.past_scale) + 1
    for size in settings.observables:
        count = size - taken
        if count < 1:
            continue
        if settings.family is Family.MONOMIALS:
            yield choose_monomials(data, scaling, past_steps, count)
        elif settings.family is Family.GAUSSIANS:
            x = (data.x[:, 0] - scaling.x_centre) / scaling.x_scale
            v = np.concatenate([x, data.w / scaling.w_scale], axis=1)
            unit = gaussians(v, count, 1.0, settings.seed)
            yield from (unit._replace(width=width * unit.width) for width in settings.widths)
        else:
            yield from (cosines(q, count, width, settings.seed) for width in settings.widths)


def _gain_columns(
    settings: EdmdSettings,
    functions: Functions,
    scaling: Scaling,
    past_steps: int,
    schema: Schema,
    roles: Roles,
) -> Iterator[tuple[int, ...]]:
    """Entries of psi that inputs are multiplied by, for every choice that this psi allows."""
    n_x = len(scaling.x_scale)
    first = n_x + past_steps * len(scaling.past_scale)
    states = tuple(range(n_x))
    for gains in settings.gains:
        if gains is Gains.NONE:
            yield ()
        elif gains is Gains.STATES:
            yield states
        elif gains is Gains.PRODUCTS:
            q = n_x + len(scaling.w_scale)
            is_product = (functions.rows < q).sum(axis=1) == 2
            yield (*states, *(first + np.flatnonzero(is_product)).tolist())
        elif roles.centred:
            speed = schema.state_names.index(roles.centred[0])
            q = n_x + len(scaling.w_scale)
            powers = [row_of_power(functions, q, speed, power) for power in (2, 3)]
            yield (speed, *(first + row for row in powers if row is not None))


_WIDTHS = {
    Family.MONOMIALS: (1.0,),
    Family.GAUSSIANS: (1.0, 2.0, 4.0),
    Family.COSINES: (3.0, 6.0, 12.0),
}

DELAYS = EdmdSettings(Family.NONE, past_steps=(1, 2, 3, 4, 6, 8, 12, 16, PAST_STEPS))

AS_MANY_AS_THE_NETWORK = 66
"""observables of the paper's network, its states among them"""

LARGE = (150, 300, 600)


def small(family: Family) -> EdmdSettings:
    """As many observables as the paper's network has."""
    return EdmdSettings(family, (AS_MANY_AS_THE_NETWORK,), widths=_WIDTHS[family])


def large(family: Family) -> EdmdSettings:
    """The best of the larger sizes, of functions as wide as the smaller dictionaries like them."""
    return EdmdSettings(family, LARGE, past_steps=(4, 12), widths=_WIDTHS[family][-2:])


def bilinear(follows: tuple[Follow, ...]) -> EdmdSettings:
    """Monomials, and inputs multiplied by some of them."""
    return EdmdSettings(
        Family.MONOMIALS,
        (AS_MANY_AS_THE_NETWORK, *LARGE[:2]),
        past_steps=(4, 12),
        gains=(Gains.SPEED, Gains.STATES, Gains.PRODUCTS),
        follows=follows,
    )


BILINEAR = bilinear((Follow.PREDICTION,))
BILINEAR_FROZEN = bilinear((Follow.START, Follow.FREE_RESPONSE))
