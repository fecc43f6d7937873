"""What the condensed QP minimises: assembled once, aimed at every tick by one product.

minimise 1/2 v' H v + f' v over v, the inputs of the horizon in units of their ranges.
"""

from typing import Protocol

import numpy as np

from rt_controller.contract.bundle import Array, Bundle
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import VehicleState
from rt_controller.control.constraints import N_INPUTS
from rt_controller.control.cost import InputCost, OutputWeights
from rt_controller.control.prediction import forced_response, free_response, impulse_responses

LATERAL = VehicleState._fields.index("ey_m")


class Situation:
    """All that the objective of a tick follows from.

    [psi_0; kappa; 1; u_prev; y_r] in one vector, y_r being the reference outputs of stages 1 … N;
    and the inputs that the last plan has for the stages.
    """

    def __init__(self, n_observables: int, horizon: int, n_outputs: int) -> None:
        n = n_observables
        self.vector = np.zeros(n + 2 + N_INPUTS + horizon * n_outputs)
        self.vector[n + 1] = 1.0
        self.undriven = self.vector[: n + 2]
        """(n + 2,), what the response without inputs follows from"""
        self.past = self.vector[: n + 2 + N_INPUTS]
        """all but the reference"""
        self.psi = self.vector[:n]
        self.road = self.vector[n : n + 1]
        """(1,), curvature in 1/m"""
        self.previous = self.vector[n + 2 : n + 2 + N_INPUTS]
        self.reference = self.vector[n + 2 + N_INPUTS :].reshape(horizon, n_outputs)
        self.expected = np.zeros((horizon, N_INPUTS))
        """(N, 3), what a bilinear model is made linear along"""


class Objective(Protocol):
    """The cost of the inputs of a horizon, a quadratic function in memory that does not move."""

    H: Array
    """(nv, nv), symmetric"""
    gradient: Array
    """(nv,), f"""
    lateral: Array
    """(N, nv), what the inputs add to e_y at stages 1 … N, in metres"""
    renews_hessian: bool
    """whether `prepare` makes a new H, and lateral response"""

    def prepare(self, situation: Situation) -> None:
        """Build what inputs do around this situation, if that is not always the same."""
        ...

    def aim(self, situation: Situation) -> None:
        """Make the gradient that of this situation, with inputs doing what was prepared."""
        ...


class ConstantObjective:
    """The objective of a model whose input matrix is constant: H for ever, f by one product.

    Paper: eq. (14).
    """

    renews_hessian = False

    def __init__(
        self, bundle: Bundle, outputs: OutputWeights, scale: Array, inputs: InputCost
    ) -> None:
        """`scale` (nv,) are the ranges of the inputs."""
        horizon, n_outputs = scale.size // N_INPUTS, outputs.stage.size
        free = free_response(bundle, horizon, n_outputs)
        responses = impulse_responses(bundle.A, bundle.B_uc, horizon, n_outputs)
        Gamma = forced_response(responses) * scale

        self.lateral = Gamma[LATERAL::n_outputs].copy()
        GtQ = Gamma.T * outputs.over(horizon)
        H = GtQ @ Gamma + inputs.H
        from_previous = np.zeros((scale.size, N_INPUTS))
        np.fill_diagonal(from_previous, inputs.from_previous)
        self.H = 0.5 * (H + H.T)
        self.gradient = np.zeros(scale.size)
        self._gradient_map = np.column_stack(
            [GtQ @ free.Phi, GtQ @ free.lam, GtQ @ free.mu, from_previous, -GtQ]
        )

    def prepare(self, situation: Situation) -> None:
        """Nothing: inputs do the same everywhere."""

    def aim(self, situation: Situation) -> None:
        np.dot(self._gradient_map, situation.vector, out=self.gradient)


def require_convex(H: Array) -> None:
    """Return if H is positive definite.

    Raises:
        ArtifactError: it is not.
    """
    smallest = float(np.linalg.eigvalsh(H)[0])
    if smallest <= 0.0:
        raise ArtifactError(
            f"The QP is not strictly convex: expected a positive smallest eigenvalue of its "
            f"Hessian, found {smallest:.3g}. Give every input a finite --mpc tolerance of change."
        )
