"""Bilinear EDMD: states, past and monomials, and inputs multiplied by some of them.

psi = [x; rows of the past; monomials of x and w; 1] in scaled signals, lifted once, and

    psi_(k+1) = A psi_k + B_uc u_k + B_uw w_k + sum_r N_r (psi_g(r) u_k).

The fit is a ridge regression of single steps; the number of observables, the past, the ridge and
the g(r) are those with the smallest log error on the validation part.

Williams, Kevrekidis and Rowley (2015) and Korda and Mezic (2018) for EDMD with inputs; Bruder, Fu
and Vasudevan (2021) for the bilinear form.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper, parser

from offline.baselines.fitting import (
    RIDGES,
    Candidate,
    Transitions,
    fit_ridge,
    moments_of,
    pick_transitions,
    ridge_solution,
)
from offline.baselines.linear import LinearModel
from offline.data.dataset import Dataset
from offline.data.signals import Scaling, fit_scaling
from rt_controller.contract.arrays import Array
from rt_controller.model.bundle import spectral_radius_of
from rt_controller.model.dynamics import Gains, Matrices, Shape
from rt_controller.model.follow import Follow
from rt_controller.model.lift import IR_VERSION, OPSET
from rt_controller.report.table import Fact

HIGHEST_DEGREE = 6
"""of monomials"""
_SAMPLES, _CHOICE_RIDGE = 40_000, 1e-8
"""transitions that the choice of monomials looks at, and its ridge"""


class Dictionary(NamedTuple):
    """The observables psi of scaled signals."""

    monomials: NDArray[np.int64]
    """(F, degree) indices of the entries of [x, w] (..., q) to multiply; q stands for a factor 1"""
    variables: int
    """q"""
    first_monomial: int
    """index in psi"""
    past_steps: int
    """rows of the past in psi"""
    gains: tuple[int, ...] = ()
    """entries of psi that the inputs are multiplied by"""


@dataclass(frozen=True)
class LiftedModel(LinearModel):
    """A dictionary and the dynamics of its observables; c is zero, since psi ends with 1."""

    dictionary: Dictionary
    ridge: float
    """that the matrices were fitted with"""

    @property
    def past_steps(self) -> int:
        """As `LinearModel.past_steps`."""
        return self.dictionary.past_steps

    def lift(self, x: Array, w: Array, past: Array) -> Array:
        """As `LinearModel.lift`."""
        return lift(self.dictionary, x, w, past)

    def fit_info(self) -> tuple[Fact, ...]:
        """Size of the dictionary, and the ridge."""
        dictionary = self.dictionary
        return (
            Fact("observables", str(len(self.matrices.A))),
            Fact("past periods", str(dictionary.past_steps)),
            Fact("functions", f"{len(dictionary.monomials)} monomials"),
            Fact("ridge", f"{self.ridge:g}"),
            Fact("spectral radius", f"{spectral_radius_of(self.matrices.A):.5f}"),
            Fact("gains", f"{len(dictionary.gains)}, following the {Follow.PREDICTION}"),
        )

    def encoder(self, n: int) -> tuple[bool, bytes]:
        """As `LinearModel.encoder`: psi = [x, scaled history, monomials of scaled x and w, 1]."""
        dictionary, scaling = self.dictionary, self.scaling
        rows = dictionary.past_steps
        past = rows * len(scaling.past_scale)
        q, degree = dictionary.variables, dictionary.monomials.shape[1]
        one = q + past
        # The rows of the past and the constant are products too, with factors 1.
        products = np.full((past + len(dictionary.monomials) + 1, degree), one)
        products[:past, 0] = q + np.arange(past)
        products[past:-1] = np.where(dictionary.monomials == q, one, dictionary.monomials)
        centres = (scaling.x_centre, 0.0 * scaling.w_scale, *rows * [scaling.past_centre])
        scales = (scaling.x_scale, scaling.w_scale, *rows * [scaling.past_scale])
        constants = {
            "centre": np.concatenate(centres, dtype=np.float32),
            "scale": np.concatenate(scales, dtype=np.float32),
            "add_one": np.array([0, 0, 0, 1]),
            "value": np.array(1.0, dtype=np.float32),
            "products": products,
            "last_axis": np.array([2]),
        }
        inputs = f"float[batch, {len(scaling.x_scale)}] x, float[batch, {len(scaling.w_scale)}] w"
        nodes = ["signals = Concat <axis = 1> (x, w)"]
        if rows:
            inputs += f", float[batch, {rows}, {len(scaling.past_scale)}] history"
            nodes = ["past = Flatten (history)", "signals = Concat <axis = 1> (x, w, past)"]
        nodes += [
            "centred = Sub (signals, centre)",
            "scaled = Div (centred, scale)",
            "factors = Pad (scaled, add_one, value)",
            "chosen = Gather <axis = 1> (factors, products)",
            "observables = ReduceProd <keepdims = 0> (chosen, last_axis)",
            "psi = Concat <axis = 1> (x, observables)",
        ]
        signature = f"lift ({inputs}) => (float[batch, {n}] psi)"
        graph = parser.parse_graph("\n".join([signature, "{", *nodes, "}"]))
        for name, value in constants.items():
            graph.initializer.append(numpy_helper.from_array(value, name))
        opset = [helper.make_opsetid("", OPSET)]
        encoder = helper.make_model(graph, opset_imports=opset, ir_version=IR_VERSION)
        onnx.checker.check_model(encoder)
        return True, bytes(encoder.SerializeToString())


def fit_bilinear(
    dataset: Dataset,
    observables: tuple[int, ...],
    past_steps: tuple[int, ...],
    ridges: tuple[float, ...] = RIDGES,
) -> LiftedModel:
    """The model with the smallest validation score of all combinations of these settings.

    `observables` are sizes of psi; 66 are those of the paper's network, its states among them.

    Raises:
        DatasetError: no model predicts finite numbers, or no dictionary is larger than the states.
    """
    return fit_ridge(dataset, _candidates(dataset, observables, past_steps), ridges)


def lift(dictionary: Dictionary, x: Array, w: Array, past: Array) -> Array:
    """psi (..., n), as `LinearModel.lift`."""
    products = evaluate_monomials(dictionary.monomials, np.concatenate([x, w], axis=-1))
    rows, one = past.reshape(*x.shape[:-1], -1), np.ones((*x.shape[:-1], 1))
    return np.concatenate([x, rows, products, one], axis=-1)


def evaluate_monomials(monomials: NDArray[np.int64], v: Array) -> Array:
    """Their values (..., F) at v (..., q)."""
    factors = np.concatenate([v, np.ones((*v.shape[:-1], 1))], axis=-1)
    values = factors[..., monomials[:, 0]]
    for column in monomials.T[1:]:
        values = values * factors[..., column]
    return np.asarray(values)


def _candidates(
    dataset: Dataset, observables: tuple[int, ...], past_steps: tuple[int, ...]
) -> Iterator[Candidate[LiftedModel]]:
    """One for each past, number of observables, and choice of gains."""
    train = dataset.select("train")
    scaling = fit_scaling(train, dataset.schema, dataset.roles)
    states = len(scaling.x_scale)
    for rows in past_steps:
        data = pick_transitions(train, dataset, scaling, rows)
        first = states + rows * len(scaling.past_scale)
        none = np.zeros((0, 1), dtype=np.int64)
        start = Dictionary(none, states + len(scaling.w_scale), first, rows)
        for count in (size - first - 1 for size in observables if size > first + 1):
            chosen = _choose_monomials(start, data, count)
            for gains in choices_of_gains(chosen, dataset):
                dictionary = chosen._replace(gains=gains)
                regression = partial(_regression, dictionary)
                yield Candidate(data, regression, partial(_models, dictionary, scaling))


def choices_of_gains(dictionary: Dictionary, dataset: Dataset) -> list[tuple[int, ...]]:
    """Entries of psi that inputs are multiplied by.

    The first centred state with its powers, for the car its speed; the states; and the states with
    their products of two.
    """
    degrees = (dictionary.monomials < dictionary.variables).sum(axis=1)
    first, states = dictionary.first_monomial, tuple(range(len(dataset.schema.states)))
    speed_alone = states
    if dataset.roles.centred:
        speed = dataset.schema.state_names.index(dataset.roles.centred[0])
        is_power = (dictionary.monomials == speed).sum(axis=1) == degrees
        speed_alone = (speed, *(first + np.flatnonzero(is_power & (degrees <= 3))).tolist())
    return [speed_alone, states, (*states, *(first + np.flatnonzero(degrees == 2)).tolist())]


def _choose_monomials(start: Dictionary, data: Transitions, count: int) -> Dictionary:
    """`count` monomials of the scaled states and exogenous signals, lowest degree first.

    Of the highest degree, those are taken whose correlation with the one-step residuals of the
    lower degrees is largest.
    """
    chosen = start
    for degree in range(2, HIGHEST_DEGREE + 1):
        products = combinations_with_replacement(range(start.variables), degree)
        candidates = np.array([*products], dtype=np.int64)
        left = count - len(chosen.monomials)
        if left < len(candidates):
            relevance = _relevance(candidates, chosen, data)
            # Sorted, so that rounding does not change the order of equally relevant ones.
            candidates = candidates[np.sort(np.argsort(-relevance, kind="stable")[:left])]
        missing = ((0, 0), (0, degree - chosen.monomials.shape[1]))
        lower = np.pad(chosen.monomials, missing, constant_values=start.variables)
        chosen = chosen._replace(monomials=np.concatenate([lower, candidates]))
        if len(chosen.monomials) == count:
            break
    return chosen


def _relevance(candidates: NDArray[np.int64], chosen: Dictionary, data: Transitions) -> Array:
    """(F,) squared correlation of each with the one-step residuals, summed over the states."""
    some = Transitions(*(series[:: -(-len(data.u) // _SAMPLES)] for series in data))
    n_x = some.x.shape[2]
    regression = partial(_regression, chosen)
    operator = ridge_solution(*moments_of(some, regression), _CHOICE_RIDGE)[:n_x]
    rows, change = regression(some)
    residual = change[:, :n_x] - rows @ operator.T
    values = evaluate_monomials(candidates, np.concatenate([some.x[:, 0], some.w], axis=1))
    return np.asarray(np.square(_normalised(values).T @ _normalised(residual)).sum(axis=1))


def _normalised(columns: Array) -> Array:
    """Columns without their mean, of length one."""
    centred = columns - columns.mean(axis=0)
    length = np.sqrt(np.square(centred).sum(axis=0))
    return np.asarray(centred / np.where(length > 0.0, length, 1.0))


def _regression(dictionary: Dictionary, data: Transitions) -> tuple[Array, Array]:
    """The regressors [psi, u, w, u times each gain] (M, r) and the change of psi (M, n)."""
    psi = lift(dictionary, data.x, np.repeat(data.w[:, None], 2, axis=1), data.past)
    before, u = psi[:, 0], data.u
    products = (before[:, list(dictionary.gains), None] * u[:, None]).reshape(len(u), -1)
    return np.concatenate([before, u, data.w, products], axis=1), psi[:, 1] - before


def _models(
    dictionary: Dictionary, scaling: Scaling, operator: Array, ridge: float
) -> Iterator[LiftedModel]:
    n, m, p = len(operator), len(scaling.u_scale), len(scaling.w_scale)
    change, B_uc, B_uw, N = np.split(operator, [n, n + m, n + m + p], axis=1)
    S = np.repeat(np.eye(n)[list(dictionary.gains)], m, axis=0)
    factor, linear = np.tile(np.arange(m), len(dictionary.gains)), np.full(len(S), Shape.LINEAR)
    gains = Gains(N, S, np.zeros(len(S)), factor, linear)
    matrices = Matrices(np.eye(n) + change, B_uc, B_uw, np.zeros(n), gains)
    yield LiftedModel(scaling, matrices, dictionary, ridge)
