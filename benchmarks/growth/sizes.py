"""Models of any number of latents and horizons of any length, driven along one imagined weave."""

from dataclasses import replace

import numpy as np

from rt_controller.contract.bundle import Bundle
from rt_controller.control.objective import Situation

HORIZONS = (10, 20, 40, 80, 160)
LATENTS = (0, 8, 20, 60, 120, 240)
SPEED_MPS = 22.0


def widened(linear: Bundle, latents: int) -> Bundle:
    """The linear model with so many fading latents more, which its states feed and are fed by."""
    rng = np.random.default_rng(latents)
    n = linear.n_observables
    A = np.zeros((n + latents, n + latents))
    A[:n, :n] = linear.A
    if latents:
        memory = rng.normal(size=(latents, latents))
        A[n:, n:] = 0.9 / np.abs(np.linalg.eigvals(memory)).max() * memory
        A[:n, n:] = 1e-3 * rng.normal(size=(n, latents))
        A[n:, :n] = 1e-2 * rng.normal(size=(latents, n))
    drives = rng.normal(size=(latents, linear.B_uc.shape[1]))
    shown = rng.normal(size=(len(linear.selftest_psi), latents))
    return replace(
        linear,
        A=A,
        B_uc=np.vstack([linear.B_uc, 1e-2 * drives]),
        B_uw=np.vstack([linear.B_uw, np.zeros((latents, 1))]),
        c=np.concatenate([linear.c, np.zeros(latents)]),
        selftest_psi=np.hstack([linear.selftest_psi, shown]),
    )


def weave(situation: Situation, tick: int) -> None:
    """A car that swings about its path, faster than it should be."""
    phase = 0.15 * tick
    situation.psi[:] = 0.0
    situation.psi[:6] = (
        SPEED_MPS,
        0.05 * np.sin(phase),
        0.05 * np.cos(phase),
        0.025 * SPEED_MPS,
        0.3 * np.sin(phase),
        0.03 * np.cos(phase),
    )
    situation.previous[:] = (0.1, 0.0, 0.2 * np.sin(phase))
    situation.reference[:] = 0.0
    situation.reference[:, 0] = SPEED_MPS + 0.5
    situation.reference[:, 3] = 0.025 * SPEED_MPS
