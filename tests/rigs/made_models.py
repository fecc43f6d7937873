"""Model bundles made for tests: the shipped linear model, shown more and bent on demand.

The latents z = tanh(W [x; w; history] + b) lean on all that the lift shows. They touch the states
as little as a test asks for, so that a car can be driven with them.
"""

from dataclasses import replace

import numpy as np
import onnx_bytes

from rt_controller.contract.arrays import Array
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import NO_SIGNAL, Bilinear, Drift
from rt_controller.model.lift import Lift, LiftSample
from rt_controller.model.validation import DRIVABLE_HISTORY

N_LATENTS = 5
SHOWN_TYPICALLY = {
    "x": np.array([20.0, 0.2, 0.1, 0.5, 0.5, 0.05]),
    "w": np.array([0.004]),
    "history": np.array([20.0, 0.2, 0.1, 0.3, 30.0, 0.3]),
}

WITH_ROAD = Lift(sees_exogenous=True)
WITH_PAST = Lift(history_steps=4, history_fields=DRIVABLE_HISTORY)
WITH_ALL = replace(WITH_PAST, sees_exogenous=True)


def make_bundle(
    lift: Lift,
    *,
    rank: int = 0,
    bend: float = 0.2,
    saturates: bool = False,
    drift: int = 0,
    latents: int = N_LATENTS,
    seed: int = 0,
) -> Bundle:
    """The linear model with latents; `bend`: how much of B_uc a typical lifted state changes.

    `drift`: terms that saturate, and as many products with the curvature.
    """
    rng = np.random.default_rng(seed)
    linear = load_bundle(shipped_model("lti"))
    n_x, m = linear.B_uc.shape
    n = n_x + latents
    A, B_uc, B_uw, c = np.zeros((n, n)), np.zeros((n, m)), np.zeros((n, 1)), np.zeros(n)
    A[:n_x, :n_x], B_uc[:n_x], B_uw[:n_x], c[:n_x] = linear.A, linear.B_uc, linear.B_uw, linear.c
    A[:n_x, n_x:] = 1e-4 * rng.normal(size=(n_x, latents))
    A[n_x:, n_x:] = 0.9 * np.eye(latents)

    sample = make_sample(lift, instants=16, seed=seed)
    W = rng.normal(size=(sum(map(np.size, _flat(lift, sample, 0))), latents))
    W /= np.sqrt(len(W)) * np.concatenate(_typical(lift))[:, None]
    bias = 0.1 * rng.normal(size=latents)
    psi = lift_by_hand(lift, W, bias, sample)
    return replace(
        linear,
        name="made",
        plans=None,  # those of the linear model
        A=A,
        B_uc=B_uc,
        B_uw=B_uw,
        c=c,
        bilinear=None if rank == 0 else _bend(B_uc, psi, rank, bend, rng, saturates),
        drift=None if drift == 0 else _drift(psi, drift, bend, rng),
        lift=lift,
        encoder_onnx=write_encoder(lift, W, bias),
        selftest=sample,
        selftest_psi=psi,
    )


def make_sample(lift: Lift, instants: int, seed: int = 0) -> LiftSample:
    """What a car might have shown to such a lift."""
    rng = np.random.default_rng(seed)
    x, w, past = (SHOWN_TYPICALLY[name] for name in ("x", "w", "history"))
    rows = (instants, lift.history_steps, len(lift.history_fields))
    return LiftSample(
        x=x * rng.normal(1.0, 0.3, size=(instants, x.size)),
        w=w * rng.normal(size=(instants, w.size)),
        history=past[: rows[2]] * rng.normal(1.0, 0.3, size=rows),
    )


def lift_by_hand(lift: Lift, W: np.ndarray, bias: np.ndarray, sample: LiftSample) -> np.ndarray:
    """psi (b, n) in float32, without an encoder."""
    shown = np.array([np.concatenate(_flat(lift, sample, row)) for row in range(len(sample.x))])
    z = np.tanh(shown.astype(np.float32) @ W.astype(np.float32) + bias.astype(np.float32))
    return np.concatenate([sample.x.astype(np.float32), z], axis=1).astype(np.float64)


def write_encoder(lift: Lift, W: np.ndarray, bias: np.ndarray) -> bytes:
    """The same as ONNX."""
    shapes = {
        "x": ("batch", 6),
        "w": ("batch", 1),
        "history": ("batch", lift.history_steps, len(lift.history_fields)),
    }
    nodes = [onnx_bytes.node("Flatten", [name], f"flat_{name}", axis=1) for name in lift.inputs]
    nodes += [
        onnx_bytes.node("Concat", [f"flat_{name}" for name in lift.inputs], "shown", axis=1),
        onnx_bytes.node("Gemm", ["shown", "W", "bias"], "layer"),
        onnx_bytes.node("Tanh", ["layer"], "z"),
        onnx_bytes.node("Concat", ["x", "z"], "psi", axis=1),
    ]
    return onnx_bytes.model(
        nodes,
        [onnx_bytes.value(name, shapes[name]) for name in lift.inputs],
        [onnx_bytes.value("psi", ("batch", 6 + bias.size))],
        [
            onnx_bytes.constant("W", W.astype(np.float32)),
            onnx_bytes.constant("bias", bias.astype(np.float32)),
        ],
    )


def _flat(lift: Lift, sample: LiftSample, row: int) -> list[np.ndarray]:
    return [getattr(sample, name)[row].reshape(-1) for name in lift.inputs]


def _typical(lift: Lift) -> list[np.ndarray]:
    repeats = {"x": 1, "w": 1, "history": lift.history_steps}
    return [np.tile(SHOWN_TYPICALLY[name], repeats[name]) for name in lift.inputs]


def _bend(
    B_uc: Array, psi: Array, rank: int, bend: float, rng: np.random.Generator, saturates: bool
) -> Bilinear:
    """Directions as large as `bend` times B_uc, read from psi with gains around one."""
    n, m = B_uc.shape
    S = rng.normal(size=(rank, m, n)) / (psi.std(axis=0) * np.sqrt(n))
    s0 = rng.normal(size=(rank, m)) - np.einsum("rin,n->ri", S, psi.mean(axis=0))
    N = bend * B_uc * rng.normal(size=(rank, n, m)) / np.sqrt(rank)
    return Bilinear(N, S, s0, saturates=saturates)


def _drift(psi: np.ndarray, rank: int, bend: float, rng: np.random.Generator) -> Drift:
    """Terms that change a typical lifted state by a tenth of `bend` times its spread."""
    n, D = psi.shape[1], 2 * rank
    S = rng.normal(size=(D, n)) / (psi.std(axis=0) * np.sqrt(n))
    s0 = 0.5 * rng.normal(size=D) - S @ psi.mean(axis=0)
    signal = np.repeat([NO_SIGNAL, 0], rank)
    size = np.where(signal == NO_SIGNAL, 1.0, 1.0 / SHOWN_TYPICALLY["w"])
    N = 0.1 * bend * psi.std(axis=0)[:, None] * rng.normal(size=(n, D)) * size
    return Drift(N, S, s0, signal)


def added_columns(bilinear: Bilinear, psi: Array) -> Array:
    """B_eff - B_uc at the lifted states psi (..., n): (..., n, m)."""
    columns: Array = np.einsum("rni,...ri->...ni", bilinear.N, gains_of(bilinear, psi))
    return columns


def input_matrix(bundle: Bundle, psi: Array) -> Array:
    """B_eff (..., n, m) at the lifted states psi (..., n), those of `Bilinear.follows`."""
    if bundle.bilinear is None:
        return np.broadcast_to(bundle.B_uc, (*psi.shape[:-1], *bundle.B_uc.shape))
    return bundle.B_uc + added_columns(bundle.bilinear, psi)


def gains_of(bilinear: Bilinear, psi: Array) -> Array:
    """The share of each direction at psi (..., n): (..., R, m)."""
    shares: Array = np.einsum("rin,...n->...ri", bilinear.S, psi) + bilinear.s0
    return np.tanh(shares) if bilinear.saturates else shares


def drift_terms(drift: Drift, psi: Array, w: Array) -> Array:
    """tanh(a) - a or tanh(a) w (..., D) at psi (..., n), with w (..., p)."""
    a = psi @ drift.S.T + drift.s0
    return np.asarray(np.tanh(a) * drift.factors(w) - a * drift.is_saturation)
