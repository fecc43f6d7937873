"""The lifted model over a horizon, condensed: the outputs to come as a function of u alone."""

from dataclasses import dataclass

import numpy as np

from rt_controller.contract.artifact import Array, Bundle


@dataclass(frozen=True, slots=True)
class CondensedPrediction:
    """Y = Phi psi_0 + Gamma U + lam kappa + mu, for the outputs y_1 … y_N stacked.

    With p outputs a stage: Phi (N p, n), Gamma (N p, 3 N), lam (N p,), mu (N p,).
    """

    Phi: Array
    Gamma: Array
    lam: Array
    mu: Array


def condense(bundle: Bundle, horizon: int, n_outputs: int) -> CondensedPrediction:
    """Eliminate the states of eq. (14): the first `n_outputs` observables over `horizon` steps.

    The size of what remains does not depend on the number of latents, which is why a lifted model
    costs no more than a linear one. Curvature is constant over the horizon, as in the paper.

    Paper: eq. (14), its equality constraints.
    """
    n, m = bundle.n_observables, bundle.B_uc.shape[1]
    Phi = np.zeros((horizon, n_outputs, n))
    Gamma = np.zeros((horizon, n_outputs, horizon, m))
    lam = np.zeros((horizon, n_outputs))
    mu = np.zeros((horizon, n_outputs))

    # One recursion forward in k: psi_k = S psi_0 + R U + w kappa + d.
    S = np.eye(n)
    R = np.zeros((n, horizon, m))
    w = np.zeros(n)
    d = np.zeros(n)
    for k in range(horizon):
        S = bundle.A @ S
        R = np.tensordot(bundle.A, R, axes=1)
        R[:, k, :] += bundle.B_uc
        w = bundle.A @ w + bundle.B_uw[:, 0]
        d = bundle.A @ d + bundle.c
        Phi[k], Gamma[k], lam[k], mu[k] = S[:n_outputs], R[:n_outputs], w[:n_outputs], d[:n_outputs]

    rows = horizon * n_outputs
    return CondensedPrediction(
        Phi=Phi.reshape(rows, n),
        Gamma=Gamma.reshape(rows, horizon * m),
        lam=lam.reshape(rows),
        mu=mu.reshape(rows),
    )
