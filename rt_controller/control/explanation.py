"""Explanation of one plan: which bounds it touches, what its cost consists of, a second solution.

For people, after a drive; nothing of it runs in the loop.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import N_INPUTS, ControlInput, StateColumn, VehicleState
from rt_controller.control.objective import QpParameters
from rt_controller.control.program import QuadraticProgram, SolveStatus
from rt_controller.control.terms import Corridor, TrackingCost
from rt_controller.control.warm_start import open_solver

ACTIVE = 1e-6
"""distance to a bound, in units of an input's range, from which on it is active"""


class ActiveBound(NamedTuple):
    """A bound of the QP that holds with equality."""

    kind: str
    """"value" of an input at a knot, its "change" from the knot before, or "corridor" around the
    path"""
    signal: str
    stage: int
    """of the knot, counted from zero; of the corridor from one"""
    side: str
    """lower, upper, or both where they are equal"""
    multiplier: float
    """decrease of the cost if the bound is relaxed by one range of the input; negative for a lower
    bound; 0: other bounds imply it"""


class CostShare(NamedTuple):
    """One term of the cost, summed over the horizon."""

    term: str
    cost: float
    share: float
    """of the sum of all terms; 0 if that is zero"""


class SecondSolution(NamedTuple):
    """The same QP solved again from a cold start, by PIQP."""

    status: SolveStatus
    iterations: int
    largest_difference: float
    """of an input, in units of its range; NaN if either was not solved"""
    optimality_residual: float
    """largest component of the gradient that no active bound balances; NaN without a plan"""


class PlanExplanation(NamedTuple):
    """One solve of eq. (14), explained."""

    inputs: Array
    """(N, 3), planned"""
    states: Array
    """(N + 1, 6), predicted, that at which the plan begins first; e_y and e_psi counted from the
    road"""
    reference: Array
    """(N, 6), of stages 1 … N; e_y and e_psi counted from the circle of the curvature at the car"""
    active: tuple[ActiveBound, ...]
    costs: tuple[CostShare, ...]
    second: SecondSolution


def solve_again(program: QuadraticProgram, z: Array | None, n_inputs: int) -> SecondSolution:
    """The program solved from a cold start, compared with `z` (n,), the solution in use.

    `n_inputs` of its variables are inputs.
    """
    if not program.has_finite_matrices():
        return SecondSolution(SolveStatus.NUMERICS, 0, np.nan, np.nan)
    copy = program.copy()
    solver = open_solver(copy, warm_start=False)
    status = solver.solve()
    if z is None:
        return SecondSolution(status, solver.iterations, np.nan, np.nan)
    difference = np.nan
    if status is SolveStatus.SOLVED:
        difference = float(np.abs(solver.solution - z)[:n_inputs].max())
    return SecondSolution(status, solver.iterations, difference, _multipliers(program, z)[-1])


def active_bounds(
    program: QuadraticProgram, z: Array, knot_stages: Sequence[int]
) -> tuple[ActiveBound, ...]:
    """The bounds that are active at the solution `z` (n,), by variable, then by row."""
    n_inputs = N_INPUTS * len(knot_stages)
    indices, signs, multipliers, _ = _multipliers(program, z)
    found = []
    for index, sign, multiplier in zip(indices.tolist(), signs, multipliers, strict=True):
        place = index - program.size
        knot, column = divmod(index if place < 0 else place, N_INPUTS)
        if place >= n_inputs:
            kind, signal, stage = "corridor", "ey_m", place - n_inputs + 1
        else:
            kind, signal = "value" if place < 0 else "change", ControlInput._fields[column]
            stage = knot_stages[knot]
        is_equal = program.all_upper[index] - program.all_lower[index] <= ACTIVE
        side = "both" if is_equal else "upper" if sign > 0.0 else "lower"
        found.append(ActiveBound(kind, signal, stage, side, float(sign * multiplier)))
    return tuple(found)


def _multipliers(
    program: QuadraticProgram, z: Array
) -> tuple[NDArray[np.int64], Array, Array, float]:
    """The active bounds, their multipliers by least squares, and what of the gradient remains.

    Indices among variables and rows, and +1 for an upper bound, -1 for a lower one.
    """
    values = np.concatenate([z, program.G @ z])
    above = program.all_upper - values <= ACTIVE
    indices = np.flatnonzero(above | (values - program.all_lower <= ACTIVE))
    signs = np.where(above[indices], 1.0, -1.0)
    normals = np.vstack([np.eye(program.size), program.G])[indices] * signs[:, None]
    gradient = program.P @ z + program.q
    multipliers = np.zeros(len(indices))
    if len(indices):
        multipliers[:] = np.linalg.lstsq(normals.T, -gradient, rcond=None)[0]
    return indices, signs, multipliers, float(np.abs(normals.T @ multipliers + gradient).max())


def cost_shares(
    cost: TrackingCost,
    corridor: Corridor | None,
    states: Array,
    parameters: QpParameters,
    inputs: Array,
    length_m: Array,
    intervals: Array,
) -> tuple[CostShare, ...]:
    """The terms of eq. (14) that are not zero, the largest first; a half of each square.

    `states` (K + 1, 6) are predicted under `inputs` (N, 3) at the knots and at the end, `intervals`
    (K,) the periods between them, `length_m` (K,) that over which the course is computed.
    """
    stage_weights = intervals.copy()
    stage_weights[-1] *= cost.terminal_factor
    names, ey = list(VehicleState._fields), StateColumn.ey_m
    all_stages = states - parameters.reference
    deviation = all_stages[1:].copy()
    if cost.heading == "course":
        names[StateColumn.epsi_rad] = "course"
        deviation[:, StateColumn.epsi_rad] = np.diff(all_stages[:, ey]) / length_m
    terms = {
        f"deviation of {name}": stage_weights @ np.square(deviation[:, i] / cost.state[i])
        for i, name in enumerate(names)
    }
    changes = np.diff(inputs, axis=0, prepend=parameters.previous[None])
    for i, name in enumerate(ControlInput._fields):
        terms[f"size of {name}"] = np.square(inputs[:, i] / cost.control[i]).sum()
        terms[f"change of {name}"] = np.square(changes[:, i] / cost.control_change[i]).sum()
    if corridor is not None:
        excess_m = np.abs(deviation[:, ey]) - corridor.half_width_m
        terms["beyond the corridor"] = corridor.weight * np.square(np.maximum(excess_m, 0.0)).sum()
    total = float(sum(terms.values()))
    shares = [
        CostShare(name, 0.5 * float(value), float(value) / total if total else 0.0)
        for name, value in terms.items()
        if value > 0.0
    ]
    return tuple(sorted(shares, key=lambda term: -term.cost))
