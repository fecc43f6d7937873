"""Model bundles made for tests: the shipped linear model, shown more and bent on demand.

The latents z = tanh(W [x; w; history] + b) lean on all that the lift shows. They touch the states
as little as a test asks for, so that a car can be driven with them.
"""

from dataclasses import replace

import numpy as np
import onnx_bytes

from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import N_INPUTS, PATH_STATES
from rt_controller.contract.timing import PERIOD_S
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Dynamics, Gains, Shape, Step
from rt_controller.model.lift import Lift, LiftSample
from rt_controller.model.path_kinematics import Movement
from rt_controller.model.validation import DRIVABLE_HISTORY

N_LATENTS = 5
SHOWN_TYPICALLY = {
    "x": np.array([20.0, 0.2, 0.1, 0.5, 0.5, 0.05]),
    "w": np.array([0.004]),
    "history": np.array([20.0, 0.2, 0.1, 0.3, 30.0, 0.3]),
}

RANGE = np.subtract(INPUT_LIMITS.upper, INPUT_LIMITS.lower)
VARIANTS = {
    "linear": {},
    "bilinear of rank 1": {"rank": 1},
    "bilinear": {"rank": 4},
    "saturating": {"rank": 4, "saturates": True},
    "drift": {"drift": 2},
    "bilinear with drift": {"rank": 1, "drift": 2},
    "saturating with drift": {"rank": 3, "saturates": True, "drift": 2},
    "exact path": {"rank": 3, "saturates": True, "drift": 2, "has_exact_path": True},
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
    has_exact_path: bool = False,
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
    parts = [_bend(B_uc, psi, rank, bend, rng, saturates)] if rank else []
    parts += [_drift(psi, drift, bend, rng)] if drift else []
    gains = join_gains(*parts) if parts else None
    movement = None
    if has_exact_path:
        A[PATH_STATES] = A[:, PATH_STATES] = B_uc[PATH_STATES] = B_uw[PATH_STATES] = 0.0
        c[PATH_STATES] = gains.N[PATH_STATES] = gains.S[:, PATH_STATES] = 0.0
        S = PERIOD_S * (np.eye(3, n) + 0.01 * rng.normal(size=(3, n)) / psi.std(axis=0))
        S[:, PATH_STATES] = 0.0
        movement = Movement(S, 1e-3 * rng.normal(size=3))
    return replace(
        linear,
        name="made",
        plans=None,  # those of the linear model
        A=A,
        B_uc=B_uc,
        B_uw=B_uw,
        c=c,
        gains=gains,
        movement=movement,
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
) -> Gains:
    """Directions as large as `bend` times B_uc, read from psi with gains around one."""
    n, m = B_uc.shape
    S = rng.normal(size=(rank, m, n)) / (psi.std(axis=0) * np.sqrt(n))
    s0 = rng.normal(size=(rank, m)) - np.einsum("rin,n->ri", S, psi.mean(axis=0))
    N = bend * B_uc * rng.normal(size=(rank, n, m)) / np.sqrt(rank)
    return input_gains(N, S, s0, saturates)


def _drift(psi: np.ndarray, rank: int, bend: float, rng: np.random.Generator) -> Gains:
    """Terms that change a typical lifted state by a tenth of `bend` times its spread."""
    n, D = psi.shape[1], 2 * rank
    S = rng.normal(size=(D, n)) / (psi.std(axis=0) * np.sqrt(n))
    s0 = 0.5 * rng.normal(size=D) - S @ psi.mean(axis=0)
    factor = np.repeat([4, 3], rank)
    size = np.where(factor == 4, 1.0, 1.0 / SHOWN_TYPICALLY["w"])
    N = 0.1 * bend * psi.std(axis=0)[:, None] * rng.normal(size=(n, D)) * size
    return saturations(N, S, s0, factor, one=4)


def input_gains(N: Array, S: Array, s0: Array, saturates: bool) -> Gains:
    """Gains of all m inputs, given R directions each: N (R, n, m), S (R, m, n), s0 (R, m)."""
    R, n, m = N.shape
    shape = np.full(R * m, Shape.TANH if saturates else Shape.LINEAR, dtype=np.int64)
    directions = N.transpose(1, 0, 2).reshape(n, -1)
    return Gains(directions, S.reshape(-1, n), s0.reshape(-1), np.arange(R * m) % m, shape)


def saturations(N: Array, S: Array, s0: Array, factor: Array, one: int) -> Gains:
    """Gains N (n, D), S (D, n), s0 (D,): tanh(a) - a where the factor is `one`, else tanh(a)."""
    shape = np.where(factor == one, Shape.SATURATION, Shape.TANH)
    return join_gains(Gains(N, S, s0, factor, shape))


def join_gains(*parts: Gains) -> Gains:
    """One list of gains, in the order of their shapes."""
    N = np.concatenate([part.N for part in parts], axis=1)
    S, s0, factor, shape = (
        np.concatenate([part[i] for part in parts]) for i in range(1, len(parts[0]) - 1)
    )
    order = np.argsort(shape, kind="stable")
    return Gains(N[:, order], S[order], s0[order], factor[order], shape[order], parts[0].follows)


def one_step(model: Dynamics, psi: Array, u: Array, w: Array) -> Array:
    """psi_(k+1) (..., n) from psi (..., n), inputs u (..., m) and exogenous signals w (..., p)."""
    return Step(model)(psi, np.concatenate((u, w, np.ones((*u.shape[:-1], 1))), axis=-1))


def added_by_gains(gains: Gains, psi: Array, u: Array, w: Array) -> Array:
    """What the gains add (..., n) at psi (..., n), written out one by one."""
    added = np.zeros(psi.shape)
    factors = np.concatenate((u, w, np.ones((*u.shape[:-1], 1))), axis=-1)
    for N, S, s0, factor, shape in zip(gains.N.T, *gains[1:5], strict=True):
        a = psi @ S + s0
        t = {Shape.LINEAR: a, Shape.TANH: np.tanh(a), Shape.SATURATION: np.tanh(a) - a}[shape]
        added += (t * factors[..., factor])[..., None] * N
    return added


def input_matrix(bundle: Bundle, psi: Array) -> Array:
    """B_eff (..., n, m) at the lifted states psi (..., n), those of `Gains.follows`."""
    B = np.broadcast_to(bundle.B_uc, (*psi.shape[:-1], *bundle.B_uc.shape))
    if bundle.gains is None:
        return B
    m, w = B.shape[-1], np.zeros((*psi.shape[:-1], bundle.B_uw.shape[1]))
    undriven = added_by_gains(bundle.gains, psi, np.zeros((*psi.shape[:-1], m)), w)
    columns = [
        added_by_gains(bundle.gains, psi, np.broadcast_to(u, (*psi.shape[:-1], m)), w) - undriven
        for u in np.eye(m)
    ]
    return B + np.stack(columns, axis=-1)


def made(variant: str, lift: Lift | None = None) -> Bundle:
    """Of one of the classes of models."""
    return make_bundle(lift or Lift(), bend=0.5, **VARIANTS[variant])


def knots_of(count: int) -> Array:
    """(K, 3), a plan whose inputs change."""
    return RANGE * (0.1 + 0.2 * np.random.default_rng(5).normal(size=(count, N_INPUTS)))
