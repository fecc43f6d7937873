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
from enum import StrEnum
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper, parser

from offline.baselines.baseline import describe_fit, require_windows
from offline.baselines.fitting import (
    MOST_TRANSITIONS,
    RIDGES,
    Moments,
    Transitions,
    best_model,
    moments,
    pick_transitions,
    ridge_solution,
)
from offline.data.dataset import Dataset
from offline.data.signals import Scaling, fit_scaling, last_rows, past_names
from rt_controller.contract.arrays import Array
from rt_controller.model.bundle import Bundle, spectral_radius_of
from rt_controller.model.dynamics import Gains, Matrices, Shape, roll_out
from rt_controller.model.follow import Follow
from rt_controller.model.lift import IR_VERSION, OPSET, Lift, LiftSample
from rt_controller.report.table import Fact

HIGHEST_DEGREE = 6
"""of monomials"""
_SAMPLES = 40_000
"""transitions that the choice of monomials looks at"""
_CHOICE_RIDGE = 1e-8


class GainColumns(StrEnum):
    """Which observables the inputs are multiplied by."""

    SPEED = "speed"
    """the first centred state and its powers: for the car, its speed"""
    STATES = "states"
    PRODUCTS = "products"
    """the states and their products of two"""


@dataclass(frozen=True, slots=True)
class BilinearSettings:
    """The values that are tried, in all combinations."""

    observables: tuple[int, ...] = (66, 150, 300)
    """sizes of psi; 66 are those of the paper's network, its states among them"""
    past_steps: tuple[int, ...] = (4, 12)
    ridges: tuple[float, ...] = RIDGES
    gains: tuple[GainColumns, ...] = tuple(GainColumns)


class Dictionary(NamedTuple):
    """The observables psi of signals in physical units."""

    monomials: NDArray[np.int64]
    """(F, degree) indices of the entries of [x, w] (..., q) to multiply; q stands for a factor 1"""
    scaling: Scaling
    past_steps: int = 0
    """rows of the past in psi"""
    gains: tuple[int, ...] = ()
    """entries of psi that the inputs are multiplied by"""

    @property
    def variables(self) -> int:
        """q, the number of the entries of [x, w]."""
        return len(self.scaling.x_scale) + len(self.scaling.w_scale)

    @property
    def first_monomial(self) -> int:
        """Index in psi."""
        return len(self.scaling.x_scale) + self.past_steps * len(self.scaling.past_scale)

    def lift(self, x: Array, w: Array, past: Array) -> Array:
        """psi (..., n) of states (..., n_x), w (..., p) and past (..., H, h), H >= past_steps."""
        scaling = self.scaling
        x = scaling.normalise_states(x)
        parts = [x]
        if self.past_steps:
            last = (last_rows(past, self.past_steps) - scaling.past_centre) / scaling.past_scale
            parts.append(last.reshape(*x.shape[:-1], -1))
        v = np.concatenate([x, w / scaling.w_scale], axis=-1)
        parts.append(evaluate_monomials(self.monomials, v))
        return np.concatenate([*parts, np.ones((*x.shape[:-1], 1))], axis=-1)


@dataclass(frozen=True, slots=True)
class LiftedModel:
    """A dictionary and the dynamics of its observables."""

    dictionary: Dictionary
    matrices: Matrices
    """of psi and scaled signals; c is zero, since psi ends with 1"""
    ridge: float
    """that the matrices were fitted with"""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n_x), as `Predictor.predict`."""
        scaling, past_steps = self.dictionary.scaling, self.dictionary.past_steps
        n_x, past_signals = len(scaling.x_scale), len(scaling.past_scale) if past_steps else 0
        signals = (n_x, len(scaling.u_scale), len(scaling.w_scale))
        require_windows(x0, past, U, W, signals, past_signals, past_steps)
        psi0 = self.dictionary.lift(x0, W[:, 0], past)
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = roll_out(self.matrices, psi0, U / scaling.u_scale, W / scaling.w_scale, n_x)
        states = scaled * scaling.x_scale + scaling.x_centre
        states[:, 0] = x0
        return states

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


def monomials_of(q: int, degree: int) -> NDArray[np.int64]:
    """All monomials (F, degree) of a degree of v (..., q)."""
    return np.array(list(combinations_with_replacement(range(q), degree)), dtype=np.int64)


def evaluate_monomials(monomials: NDArray[np.int64], v: Array) -> Array:
    """Their values (..., F) at v (..., q)."""
    factors = np.concatenate([v, np.ones((*v.shape[:-1], 1))], axis=-1)
    values = factors[..., monomials[:, 0]]
    for column in monomials.T[1:]:
        values = values * factors[..., column]
    return np.asarray(values)


def fit_bilinear(dataset: Dataset, settings: BilinearSettings) -> LiftedModel:
    """The model with the smallest validation score of all that the settings allow.

    Raises:
        DatasetError: no model predicts finite numbers, or no dictionary is larger than the states.
    """
    return best_model(_models(dataset, settings), dataset)


def to_bundle(name: str, model: LiftedModel, dataset: Dataset, sample: LiftSample) -> Bundle:
    """The model as a bundle: its lift in ONNX, the scaling folded into the matrices.

    `sample` are instants with at least the past that it needs.
    """
    dictionary, scaling = model.dictionary, model.dictionary.scaling
    past_steps = dictionary.past_steps
    fields = past_names(dataset.schema, dataset.roles) if past_steps else ()
    history = last_rows(sample.history, past_steps)[..., : len(fields)]
    sample = LiftSample(sample.x, sample.w, history)
    psi = dictionary.lift(sample.x, sample.w, sample.history)
    psi[:, : len(scaling.x_scale)] = sample.x
    return Bundle(
        name=name,
        schema=dataset.schema,
        car=dataset.car,
        **scaling.to_physical(model.matrices)._asdict(),
        lift=Lift(True, past_steps, fields),
        encoder_onnx=_encoder(dictionary, psi.shape[1]),
        selftest=sample,
        selftest_psi=psi,
        training=describe_fit(name, model, dataset),
        data_sha256=dataset.sha256,
    )


def _models(dataset: Dataset, settings: BilinearSettings) -> Iterator[LiftedModel]:
    """One for each past, number of observables, choice of gains, and ridge."""
    train, schema, roles = dataset.select("train"), dataset.schema, dataset.roles
    scaling = fit_scaling(train, schema, roles)
    for past_steps in settings.past_steps:
        data = pick_transitions(train, schema, roles, past_steps, MOST_TRANSITIONS)
        without_monomials = Dictionary(np.zeros((0, 1), dtype=np.int64), scaling, past_steps)
        others = without_monomials.first_monomial + 1
        for count in (size - others for size in settings.observables if size > others):
            chosen = _choose_monomials(without_monomials, data, count)
            for gains in settings.gains:
                dictionary = chosen._replace(gains=_columns_of(gains, chosen, dataset))
                of = _moments(dictionary, data)
                for ridge in settings.ridges:
                    yield LiftedModel(dictionary, _solve(dictionary, of, ridge), ridge)


def _columns_of(gains: GainColumns, dictionary: Dictionary, dataset: Dataset) -> tuple[int, ...]:
    """Entries of psi that inputs are multiplied by."""
    degrees = (dictionary.monomials < dictionary.variables).sum(axis=1)
    first, states = dictionary.first_monomial, tuple(range(len(dictionary.scaling.x_scale)))
    if gains is GainColumns.PRODUCTS:
        return (*states, *(first + np.flatnonzero(degrees == 2)).tolist())
    if gains is GainColumns.STATES or not dataset.roles.centred:
        return states
    speed = dataset.schema.state_names.index(dataset.roles.centred[0])
    is_power = (dictionary.monomials == speed).sum(axis=1) == degrees
    powers = np.flatnonzero(is_power & (degrees <= 3))
    return (speed, *(first + powers).tolist())


def _choose_monomials(start: Dictionary, data: Transitions, count: int) -> Dictionary:
    """`count` monomials of the scaled states and exogenous signals, lowest degree first.

    Of the highest degree, those are taken whose correlation with the one-step residuals of the
    lower degrees is largest.
    """
    chosen = start
    for degree in range(2, HIGHEST_DEGREE + 1):
        candidates = monomials_of(start.variables, degree)
        left = count - len(chosen.monomials)
        if left < len(candidates):
            relevance = _relevance(candidates, chosen, data)
            # Sorted, so that rounding does not change the order of equally relevant ones.
            candidates = candidates[np.sort(np.argsort(-relevance, kind="stable")[:left])]
        lower = chosen.monomials
        missing = ((0, 0), (0, degree - lower.shape[1]))
        lower = np.pad(lower, missing, constant_values=start.variables)
        chosen = chosen._replace(monomials=np.concatenate([lower, candidates]))
        if len(chosen.monomials) == count:
            break
    return chosen


def _relevance(candidates: NDArray[np.int64], chosen: Dictionary, data: Transitions) -> Array:
    """(F,) squared correlation of each with the one-step residuals, summed over the states."""
    scaling = chosen.scaling
    some = Transitions(*(series[:: -(-len(data.u) // _SAMPLES)] for series in data))
    operator = _operator(_moments(chosen, some), _CHOICE_RIDGE)
    psi = chosen.lift(some.x, np.repeat(some.w[:, None], 2, axis=1), some.past)
    n_x = len(scaling.x_scale)
    u, w = some.u / scaling.u_scale, some.w / scaling.w_scale
    residual = psi[:, 1, :n_x] - np.concatenate([psi[:, 0], u, w], axis=1) @ operator[:n_x].T
    values = evaluate_monomials(candidates, np.concatenate([psi[:, 0, :n_x], w], axis=1))
    return np.asarray(np.square(_normalised(values).T @ _normalised(residual)).sum(axis=1))


def _normalised(columns: Array) -> Array:
    """Columns without their mean, of length one."""
    centred = columns - columns.mean(axis=0)
    length = np.sqrt(np.square(centred).sum(axis=0))
    return np.asarray(centred / np.where(length > 0.0, length, 1.0))


def _moments(dictionary: Dictionary, data: Transitions) -> Moments:
    """Of the regressors [psi, u, w, u times each gain] (M, r) and the change of psi (M, n)."""
    scaling = dictionary.scaling

    def regression(part: Transitions) -> tuple[Array, Array]:
        psi = dictionary.lift(part.x, np.repeat(part.w[:, None], 2, axis=1), part.past)
        before, u = psi[:, 0], part.u / scaling.u_scale
        products = (before[:, dictionary.gains, None] * u[:, None]).reshape(len(u), -1)
        rows = np.concatenate([before, u, part.w / scaling.w_scale, products], axis=-1)
        return rows, psi[:, 1] - before

    return moments(data, regression)


def _operator(of: Moments, ridge: float) -> Array:
    """[A, B_uc, B_uw, N] (n, r) of these moments."""
    operator = ridge_solution(of, ridge)
    n = len(operator)
    operator[:, :n] += np.eye(n)
    return operator


def _solve(dictionary: Dictionary, of: Moments, ridge: float) -> Matrices:
    operator = _operator(of, ridge)
    n, m, p = len(operator), len(dictionary.scaling.u_scale), len(dictionary.scaling.w_scale)
    A, B_uc, B_uw, N = np.split(operator, [n, n + m, n + m + p], axis=1)
    S = np.repeat(np.eye(n)[list(dictionary.gains)], m, axis=0)
    factor, linear = np.tile(np.arange(m), len(dictionary.gains)), np.full(len(S), Shape.LINEAR)
    gains = Gains(N, S, np.zeros(len(S)), factor, linear)
    return Matrices(A, B_uc, B_uw, np.zeros(n), gains)


def _encoder(dictionary: Dictionary, n: int) -> bytes:
    """The lift in ONNX: psi = [x, scaled history, monomials of scaled x and w, 1]."""
    scaling = dictionary.scaling
    constants: dict[str, NDArray[np.generic]] = {"one_width": np.array([1])}
    constants |= {name: getattr(scaling, name) for name in ("x_centre", "x_scale", "w_scale")}
    inputs = [f"float[batch, {len(scaling.x_scale)}] x", f"float[batch, {len(scaling.w_scale)}] w"]
    nodes = [
        "rows = Shape <start = 0, end = 1> (x)",
        "one_shape = Concat <axis = 0> (rows, one_width)",
        "one = ConstantOfShape <value = float[1] {1.0}> (one_shape)",
        "x_centred = Sub (x, x_centre)",
        "x_scaled = Div (x_centred, x_scale)",
        "w_scaled = Div (w, w_scale)",
        "factors = Concat <axis = 1> (x_scaled, w_scaled, one)",
    ]
    past = ""
    if dictionary.past_steps:
        inputs.append(f"float[batch, {dictionary.past_steps}, {len(scaling.past_scale)}] history")
        constants |= {"p_centre": scaling.past_centre, "p_scale": scaling.past_scale}
        nodes += [
            "p_centred = Sub (history, p_centre)",
            "p_scaled = Div (p_centred, p_scale)",
            "past = Flatten (p_scaled)",
        ]
        past = "past, "
    product = ""
    for i, column in enumerate(dictionary.monomials.T):
        constants[f"column_{i}"] = column
        nodes.append(f"f_{i} = Gather <axis = 1> (factors, column_{i})")
        if product:
            nodes.append(f"product_{i} = Mul ({product}, f_{i})")
        product = f"product_{i}" if product else f"f_{i}"
    nodes.append(f"psi = Concat <axis = 1> (x, {past}{product}, one)")
    signature = f"lift ({', '.join(inputs)}) => (float[batch, {n}] psi)"
    graph = parser.parse_graph("\n".join([signature, "{", *nodes, "}"]))
    for name, value in constants.items():
        kind = value.dtype if value.dtype == np.int64 else np.float32
        graph.initializer.append(
            numpy_helper.from_array(np.ascontiguousarray(value, dtype=kind), name)
        )
    opset = [helper.make_opsetid("", OPSET)]
    encoder = helper.make_model(graph, opset_imports=opset, ir_version=IR_VERSION)
    onnx.checker.check_model(encoder)
    return bytes(encoder.SerializeToString())
