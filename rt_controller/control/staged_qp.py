"""The paper's MPC with the lifted states among the variables: large, but sparse in the horizon.

Worth it where the model is small and the horizon long, see `formulation`.
"""

import numpy as np
from scipy.sparse import csc_matrix, diags, identity, kron, vstack

from rt_controller.contract.bundle import Array, Bundle
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import InputLimits
from rt_controller.control.constraints import N_INPUTS, constrain_inputs
from rt_controller.control.cost import TrackingCost, input_cost, output_weights
from rt_controller.control.objective import LATERAL, Situation
from rt_controller.control.pedals import PedalChoice, lower_ceilings
from rt_controller.control.qp import Features


class StagedQp:
    """Eq. (14) over z = [v_0, psi_1, s_1, v_1, psi_2, s_2, …]: inputs in units of their ranges.

    minimise 1/2 z' P z + q' z subject to M z = b, row_lower <= G z <= row_upper and bounds on the
    inputs. Built once; a tick changes vectors only, so the input matrix is a constant one. The
    slacks are there if there is a corridor.

    Raises:
        ArtifactError: the bundle's matrices are not finite.

    Paper: eq. (14).
    """

    renews = False

    def __init__(
        self,
        bundle: Bundle,
        horizon: int,
        cost: TrackingCost,
        limits: InputLimits,
        features: Features,
    ) -> None:
        inputs = constrain_inputs(horizon, limits)
        outputs = output_weights(cost, bundle.n_observables - len(bundle.schema.states))
        self.situation = Situation(bundle.n_observables, horizon, outputs.stage.size)
        self.scale = inputs.scale
        self._bundle, self._corridor = bundle, features.corridor
        n, m, p = bundle.n_observables, N_INPUTS, outputs.stage.size
        slack = 0 if features.corridor is None else 1
        block = m + n + slack
        size = horizon * block
        places = np.arange(size).reshape(horizon, block)
        inputs_only = csc_matrix(identity(size))[places[:, :m].reshape(-1)]

        on_inputs = input_cost(cost, inputs)
        on_stages = np.zeros((horizon, block))
        on_stages[:, m : m + p] = outputs.over(horizon).reshape(horizon, p)
        if features.corridor is not None:
            on_stages[:, -1] = features.corridor.weight
        self._from_previous = on_inputs.from_previous
        self._on_outputs = on_stages[:, m : m + p]
        self.P = csc_matrix(
            inputs_only.T @ csc_matrix(on_inputs.H) @ inputs_only + diags(on_stages.reshape(-1))
        )
        self.q = np.zeros(size)
        self._q_of_inputs = self.q.reshape(horizon, block)[0, :m]
        self._q_of_outputs = self.q.reshape(horizon, block)[:, m : m + p]

        self.M = _dynamics(bundle, inputs.scale[:m], horizon, slack)
        self.b = np.zeros(horizon * n)
        self._b_of_stages = self.b.reshape(horizon, n)

        rows = [csc_matrix(inputs.D) @ inputs_only] if features.has_slew_rows else []
        slews = inputs.slew if features.has_slew_rows else np.zeros(0)
        if slack:
            lateral = np.zeros((1, block))
            lateral[0, m + LATERAL] = lateral[0, -1] = 1.0
            rows.append(kron(identity(horizon), lateral))
        self.G = csc_matrix(vstack(rows)) if rows else csc_matrix((0, size))
        self.row_upper = np.concatenate([slews, np.zeros(slack * horizon)])
        self.row_lower = -self.row_upper
        self._first_slew = inputs.slew[:m]
        self._slews = slews.size
        self.lower, self.upper = np.full(size, -np.inf), np.full(size, np.inf)
        self.lower.reshape(horizon, block)[:, :m] = inputs.lower.reshape(horizon, m)
        self._ceilings = self.upper.reshape(horizon, block)[:, :m]
        self._ceilings[:] = inputs.upper.reshape(horizon, m)
        if not np.isfinite(self.M.data).all():
            raise ArtifactError("The model's A and B: expected numbers, found some that are none.")

    def prepare(self) -> None:
        """Nothing: the matrices are constant."""

    def aim(self, pedals: PedalChoice) -> None:
        """Make the vectors those of the situation as it stands."""
        now, bundle, m = self.situation, self._bundle, N_INPUTS
        np.multiply(-self._on_outputs, now.reference, out=self._q_of_outputs)
        np.multiply(self._from_previous, now.previous, out=self._q_of_inputs)
        self._b_of_stages[:] = bundle.c + bundle.B_uw[:, 0] * now.road
        self._b_of_stages[0] += bundle.A @ now.psi
        start = now.previous / self.scale[:m]
        if self._slews:
            np.subtract(start, self._first_slew, out=self.row_lower[:m])
            np.add(start, self._first_slew, out=self.row_upper[:m])
        lower_ceilings(self._ceilings, pedals, start, self._first_slew)
        if self._corridor is not None:
            wanted, half_m = now.reference[:, LATERAL], self._corridor.half_width_m
            np.subtract(wanted, half_m, out=self.row_lower[self._slews :])
            np.add(wanted, half_m, out=self.row_upper[self._slews :])

    def read(self, z: Array, inputs: Array) -> None:
        """Write v_0 … v_(N-1) of a solution into `inputs` (nv,)."""
        stages = len(self._ceilings)
        inputs.reshape(stages, N_INPUTS)[:] = z.reshape(stages, -1)[:, :N_INPUTS]


def _dynamics(bundle: Bundle, scale: Array, horizon: int, slack: int) -> csc_matrix:
    """M: psi_(k+1) - A psi_k - B v_k over the stages."""
    n, m = bundle.n_observables, N_INPUTS
    arrives = np.hstack([-bundle.B_uc * scale, np.eye(n), np.zeros((n, slack))])
    leaves = np.hstack([np.zeros((n, m)), -bundle.A, np.zeros((n, slack))])
    before = diags([1.0], [-1], shape=(horizon, horizon))
    return csc_matrix(kron(identity(horizon), arrives) + kron(before, leaves))
