"""The lifted model over a horizon, condensed: the outputs to come as a function of u alone."""

from dataclasses import dataclass

import numpy as np

from rt_controller.contract.bundle import Array, Bundle


@dataclass(frozen=True, slots=True)
class FreeResponse:
    """Y = Phi psi_0 + lam kappa + mu: the outputs y_1 … y_N, stacked, if no input is given.

    With p outputs a stage: Phi (N p, n), lam (N p,), mu (N p,).
    """

    Phi: Array
    lam: Array
    mu: Array


def one_step(bundle: Bundle, psi: Array, u: Array, curvature_per_m: float) -> Array:
    """psi⁺ (n,) = A psi + B_eff u + B_w kappa + c.

    Paper: eq. (8).
    """
    driven = bundle.A @ psi + bundle.input_matrix(psi) @ u
    following: Array = driven + bundle.B_uw[:, 0] * curvature_per_m + bundle.c
    return following


def free_response(bundle: Bundle, horizon: int, n_outputs: int) -> FreeResponse:
    """The first `n_outputs` observables over `horizon` steps.

    Curvature is constant over the horizon, as in the paper.

    Paper: eq. (14), its equality constraints.
    """
    n = bundle.n_observables
    Phi = np.zeros((horizon, n_outputs, n))
    lam = np.zeros((horizon, n_outputs))
    mu = np.zeros((horizon, n_outputs))

    # One recursion forward in k: psi_k = S psi_0 + w kappa + d.
    S, w, d = np.eye(n), np.zeros(n), np.zeros(n)
    for k in range(horizon):
        S = bundle.A @ S
        w = bundle.A @ w + bundle.B_uw[:, 0]
        d = bundle.A @ d + bundle.c
        Phi[k], lam[k], mu[k] = S[:n_outputs], w[:n_outputs], d[:n_outputs]

    rows = horizon * n_outputs
    return FreeResponse(Phi.reshape(rows, n), lam.reshape(rows), mu.reshape(rows))


def impulse_responses(A: Array, B: Array, horizon: int, n_outputs: int) -> Array:
    """Outputs (N, p, m) at stages 1 … N after one unit of each input at stage 0, B being (n, m)."""
    responses = np.zeros((horizon, n_outputs, B.shape[1]))
    arrived = B
    for k in range(horizon):
        responses[k] = arrived[:n_outputs]
        arrived = A @ arrived
    return responses


def forced_response(responses: Array) -> Array:
    """Gamma (N p, N m): what impulse responses (N, p, m) make of the inputs of all stages.

    The size of what remains does not depend on the number of latents, which is why a lifted model
    costs no more than a linear one.

    Paper: eq. (14), its equality constraints.
    """
    horizon, p, m = responses.shape
    Gamma = np.zeros((horizon, p, horizon, m))
    for j in range(horizon):
        Gamma[j:, :, j, :] = responses[: horizon - j]
    return Gamma.reshape(horizon * p, horizon * m)
