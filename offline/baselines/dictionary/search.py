"""EDMDc: a linear operator in a fixed dictionary, whose settings are chosen on the validation part.

One search for all variants. The dictionary is the states, rows of the past, functions of states and
curvature, and the constant; the number of each, the width of the functions and the ridge are those
that predict the validation part best over two seconds. Without functions this is DMDc with delays;
with products of observables and inputs it is bilinear EDMD.

Proctor, Brunton and Kutz (2016) for DMDc; Williams, Kevrekidis and Rowley (2015) and Korda and
Mezic (2018) for EDMD with inputs; Bruder, Fu and Vasudevan (2021) for the bilinear form.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import partial

import numpy as np

from offline.baselines.baseline import Baseline
from offline.baselines.dictionary.bundle import to_bundle
from offline.baselines.dictionary.fit import Transitions, moments, pick_transitions, solve, tune
from offline.baselines.dictionary.functions import (
    Family,
    Functions,
    cosines,
    gaussians,
    monomials,
    no_functions,
)
from offline.baselines.dictionary.model import Dictionary, LiftedModel
from offline.baselines.score import tuning_windows
from offline.data.dataset import Dataset
from offline.data.signals import Scaling, fit_scaling
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.model.follow import Follow


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
    """The values that are tried, in all combinations."""

    family: Family
    observables: tuple[int, ...] = ()
    """sizes of psi; without functions the past determines the size"""
    past_steps: tuple[int, ...] = (0, 2, 4, 8)
    widths: tuple[float, ...] = (1.0,)
    """of the functions, in typical distances (Gaussians) or spreads (cosines)"""
    ridges: tuple[float, ...] = (1e-10, 1e-8, 1e-6, 1e-5, 1e-4, 1e-3)
    gains: tuple[Gains, ...] = (Gains.NONE,)
    follows: tuple[Follow, ...] = (Follow.START,)
    """what the gains follow"""
    most_transitions: int = 250_000
    seed: int = 0


SMALL = (66,)
"""observables of the paper's network, its states among them"""

LARGE = (150, 300, 600)

HIGHEST_DEGREE = 6
"""of monomials"""
_SAMPLES = 40_000
"""transitions that the choice of monomials looks at"""
_CHOICE_RIDGE = 1e-8


def edmd(settings: EdmdSettings) -> Baseline:
    """The baseline with these settings."""
    is_linear = settings.family is Family.NONE and settings.gains == (Gains.NONE,)
    return Baseline(
        fit=partial(fit_edmd, settings=settings),
        to_bundle=to_bundle,
        model_class="linear" if is_linear else "other",
    )


def fit_edmd(dataset: Dataset, settings: EdmdSettings) -> LiftedModel:
    """The model with the smallest validation score of all that the settings allow.

    Raises:
        DatasetError: no model predicts finite numbers.
    """
    train, validation = dataset.select("train"), tuning_windows(dataset)
    scaling = fit_scaling(train, dataset.schema, dataset.roles)
    best_score, best = np.inf, None
    for past_steps in settings.past_steps:
        data = pick_transitions(
            train, dataset.schema, dataset.roles, past_steps, settings.most_transitions
        )
        for functions in _functions(settings, scaling, data, past_steps):
            without_gains = Dictionary(functions, scaling, past_steps)
            for gains in _gain_columns(settings, without_gains, dataset):
                dictionary = without_gains._replace(gains=gains)
                of = moments(dictionary, data)
                score, found = tune(dictionary, of, settings.ridges, settings.follows, validation)
                if score < best_score:
                    best_score, best = score, found
    if best is None:
        raise DatasetError(
            f"expected a dictionary of {settings.family.value} that predicts finite numbers over "
            f"the validation part, found none among {settings.observables or 'the delays'}. "
            f"Leave out this baseline, or widen its ridges."
        )
    return best


def _functions(
    settings: EdmdSettings, scaling: Scaling, data: Transitions, past_steps: int
) -> Iterator[Functions]:
    """All function sets of these settings beside so much past."""
    q = len(scaling.x_scale) + len(scaling.w_scale)
    if settings.family is Family.NONE:
        yield no_functions(q)
        return
    others = len(scaling.x_scale) + past_steps * len(scaling.past_scale) + 1
    for count in (size - others for size in settings.observables if size > others):
        if settings.family is Family.MONOMIALS:
            yield _choose_monomials(data, scaling, past_steps, count)
        elif settings.family is Family.GAUSSIANS:
            x, w = scaling.normalise_states(data.x[:, 0]), data.w / scaling.w_scale
            v = np.concatenate([x, w], axis=1)
            unit = gaussians(v, count, 1.0, settings.seed)
            yield from (unit._replace(width=width * unit.width) for width in settings.widths)
        else:
            yield from (cosines(q, count, width, settings.seed) for width in settings.widths)


def _gain_columns(
    settings: EdmdSettings, dictionary: Dictionary, dataset: Dataset
) -> Iterator[tuple[int, ...]]:
    """Entries of psi that inputs are multiplied by, for every choice that the dictionary allows."""
    functions, scaling = dictionary.functions, dictionary.scaling
    n_x = len(scaling.x_scale)
    q = n_x + len(scaling.w_scale)
    first = n_x + dictionary.past_steps * len(scaling.past_scale)
    states = tuple(range(n_x))
    for gains in settings.gains:
        if gains is Gains.NONE:
            yield ()
        elif gains is Gains.STATES:
            yield states
        elif gains is Gains.PRODUCTS:
            is_product = (functions.rows < q).sum(axis=1) == 2
            yield (*states, *(first + np.flatnonzero(is_product)).tolist())
        elif dataset.roles.centred:
            speed = dataset.schema.state_names.index(dataset.roles.centred[0])
            powers = [_row_of_power(functions, q, speed, power) for power in (2, 3)]
            yield (speed, *(first + row for row in powers if row is not None))


def _choose_monomials(
    data: Transitions, scaling: Scaling, past_steps: int, count: int
) -> Functions:
    """`count` monomials of the scaled states and exogenous signals, lowest degree first.

    Of the highest degree, those are taken whose correlation with the one-step residuals of the
    lower degrees is largest.
    """
    q = len(scaling.x_scale) + len(scaling.w_scale)
    chosen = no_functions(q)
    for degree in range(2, HIGHEST_DEGREE + 1):
        candidates = monomials(q, range(degree, degree + 1))
        left = count - len(chosen.rows)
        if left < len(candidates.rows):
            relevance = _relevance(candidates, Dictionary(chosen, scaling, past_steps), data)
            # Sorted, so that rounding does not change the order of equally relevant ones.
            best = np.sort(np.argsort(-relevance, kind="stable")[:left])
            candidates = candidates._replace(
                rows=candidates.rows[best], shifts=candidates.shifts[best]
            )
        chosen = _joined(chosen, candidates, q)
        if len(chosen.rows) == count:
            break
    return chosen


def _row_of_power(functions: Functions, q: int, entry: int, power: int) -> int | None:
    """Index of the monomial that is this entry of v (..., q) to this power; None if missing."""
    if functions.family is not Family.MONOMIALS:
        return None
    is_entry = (functions.rows == entry).sum(axis=1) == power
    is_one = (functions.rows == q).sum(axis=1)
    found = np.flatnonzero(is_entry & (is_one + power == functions.rows.shape[1]))
    return int(found[0]) if len(found) else None


def _joined(lower: Functions, higher: Functions, q: int) -> Functions:
    """Both; factors 1 are appended to the shorter products."""
    if not len(lower.rows):
        return higher
    degree = higher.rows.shape[1]
    padded = np.pad(lower.rows, ((0, 0), (0, degree - lower.rows.shape[1])), constant_values=q)
    return higher._replace(
        rows=np.concatenate([padded, higher.rows]), shifts=np.append(lower.shifts, higher.shifts)
    )


def _relevance(candidates: Functions, chosen: Dictionary, data: Transitions) -> Array:
    """(F,) squared correlation of each with the one-step residuals, summed over the states."""
    scaling = chosen.scaling
    some = Transitions(*(series[:: -(-len(data.u) // _SAMPLES)] for series in data))
    matrices = solve(chosen, moments(chosen, some), _CHOICE_RIDGE)
    psi = chosen.lift(some.x, np.repeat(some.w[:, None], 2, axis=1), some.past)
    n_x = len(scaling.x_scale)
    operator = np.concatenate([matrices.A, matrices.B_uc, matrices.B_uw], axis=1)[:n_x]
    u, w = some.u / scaling.u_scale, some.w / scaling.w_scale
    residual = psi[:, 1, :n_x] - np.concatenate([psi[:, 0], u, w], axis=1) @ operator.T
    values = candidates.evaluate(np.concatenate([psi[:, 0, :n_x], w], axis=1))
    return np.asarray(np.square(_normalised(values).T @ _normalised(residual)).sum(axis=1))


def _normalised(columns: Array) -> Array:
    """Columns without their mean, of length one."""
    centred = columns - columns.mean(axis=0)
    length = np.sqrt(np.square(centred).sum(axis=0))
    return np.asarray(centred / np.where(length > 0.0, length, 1.0))
