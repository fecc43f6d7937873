"""Which monomials a dictionary of a given size should hold."""

import numpy as np
from numpy.typing import NDArray

from offline.baselines.functions import Family, Functions, monomials, no_functions
from offline.baselines.lifted_fit import Transitions, blank_model, moments, solve
from offline.scaling import Scaling

Array = NDArray[np.float64]

HIGHEST_DEGREE = 6

_JUDGED = 40_000
"""transitions that correlations are taken over"""

_RIDGE = 1e-8


def choose_monomials(data: Transitions, scaling: Scaling, past_steps: int, count: int) -> Functions:
    """`count` monomials of the scaled states and exogenous signals, lowest degree first.

    Of the degree that does not fit in whole, those are taken that correlate most with what the
    lower degrees leave unexplained of one step of the states.
    """
    q = len(scaling.x_scale) + len(scaling.w_scale)
    chosen = no_functions(q)
    for degree in range(2, HIGHEST_DEGREE + 1):
        candidates = monomials(q, range(degree, degree + 1))
        left = count - len(chosen.rows)
        if left < len(candidates.rows):
            relevance = _relevance(candidates, chosen, data, scaling, past_steps)
            # Sorted, so that equally relevant ones do not change places with the last digit.
            best = np.sort(np.argsort(-relevance, kind="stable")[:left])
            candidates = candidates._replace(
                rows=candidates.rows[best], shifts=candidates.shifts[best]
            )
        chosen = _together(chosen, candidates, q)
        if len(chosen.rows) == count:
            break
    return chosen


def row_of_power(functions: Functions, q: int, entry: int, power: int) -> int | None:
    """Which monomial is that entry of v (..., q) to that power; None: it is not among them."""
    if functions.family is not Family.MONOMIALS:
        return None
    is_entry = (functions.rows == entry).sum(axis=1) == power
    is_one = (functions.rows == q).sum(axis=1)
    found = np.flatnonzero(is_entry & (is_one + power == functions.rows.shape[1]))
    return int(found[0]) if len(found) else None


def _together(one: Functions, other: Functions, q: int) -> Functions:
    """Both, factors of 1 filling the shorter products."""
    if not len(one.rows):
        return other
    degree = other.rows.shape[1]
    padded = np.pad(one.rows, ((0, 0), (0, degree - one.rows.shape[1])), constant_values=q)
    return other._replace(
        rows=np.concatenate([padded, other.rows]), shifts=np.append(one.shifts, other.shifts)
    )


def _relevance(
    candidates: Functions,
    chosen: Functions,
    data: Transitions,
    scaling: Scaling,
    past_steps: int,
) -> Array:
    """(F,) squared correlation of each with the one-step residuals, summed over the states."""
    every = -(-len(data.u) // _JUDGED)
    some = Transitions(*(series[::every] for series in data))
    model = blank_model(chosen, scaling, past_steps)
    model = solve(model, moments(model, some), _RIDGE)
    psi = model.lift(some.x, np.repeat(some.w[:, None], 2, axis=1), some.past)
    n_x = len(scaling.x_scale)
    operator = np.concatenate([model.A, model.B_uc, model.B_uw], axis=1)[:n_x]
    u, w = some.u / model.u_scale, some.w / model.w_scale
    residual = psi[:, 1, :n_x] - np.concatenate([psi[:, 0], u, w], axis=1) @ operator.T
    v = np.concatenate([psi[:, 0, :n_x], w], axis=1)
    values = candidates.evaluate(v)
    return np.asarray(np.square(_unit(values).T @ _unit(residual)).sum(axis=1))


def _unit(columns: Array) -> Array:
    """Columns without their mean, of length one."""
    moved = columns - columns.mean(axis=0)
    length = np.sqrt(np.square(moved).sum(axis=0))
    return np.asarray(moved / np.where(length > 0.0, length, 1.0))
