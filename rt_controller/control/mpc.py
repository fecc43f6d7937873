"""Model predictive control of eq. (14): state and path in, planned inputs out."""

import time
from collections.abc import Callable

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.rollout import one_step, roll_out
from rt_controller.contract.model.validation import require_drivable
from rt_controller.contract.schema import N_INPUTS, N_STATES
from rt_controller.contract.signals import (
    ControlInput,
    CurvaturePreview,
    PathReference,
    VehicleState,
)
from rt_controller.control.explanation import (
    PlanExplanation,
    active_bounds,
    cost_shares,
    solve_again,
)
from rt_controller.control.lift import Encoder, History
from rt_controller.control.pedals import PedalChoice, open_throttle
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.qp import WITH_SLEW, CondensedQp, Features
from rt_controller.control.reference import ReferenceHorizon
from rt_controller.control.solver import Solver, SolveStatus, open_solver
from rt_controller.control.terms import TrackingCost

STRAIGHT_PATH = PathReference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Mpc:
    """The MPC of eq. (14) with the model of one bundle, everything allocated at start.

    A period is `observe`, `plan`, and, in the time until the next one, `prepare` and `warm_up`.

    Raises:
        ArtifactError: the bundle is not of this car, or its encoder or QP cannot be used.
        ConfigError: latents have a weight, and the lift needs a history that a reference has not.

    Paper: eq. (14).
    """

    def __init__(
        self,
        bundle: Bundle,
        horizon: int,
        cost: TrackingCost,
        features: Features = WITH_SLEW,
        open_solver: Callable[[QuadraticProgram], Solver] = open_solver,
    ) -> None:
        require_drivable(bundle)
        if cost.latent_weight > 0.0 and bundle.lift.sees_history:
            raise ConfigError(
                f"The model {bundle.name!r} lifts a state together with its history, and a "
                f"reference state has none: expected `mpc.latent_weight` 0, found "
                f"{cost.latent_weight:g}. Leave the weight at 0, or choose a model whose lift "
                f"has no history."
            )
        self._bundle = bundle
        self._cost, self._corridor = cost, features.corridor
        self._encoder = Encoder(bundle)
        rows = self._encoder.history
        self._history = None if rows is None else History(rows)
        self._reference = ReferenceHorizon(horizon)
        self._pedals = PedalChoice()
        self._qp = CondensedQp(bundle, horizon, cost, features)
        self._solver = open_solver(self._qp.program)
        self._tracks_latents = self._qp.parameters.reference.shape[1] > N_STATES
        self.solve_ns = 0
        """time of the last solve"""
        self.max_iterations: int | None = None
        """of a solve, where its time is limited"""
        self.inputs = np.zeros((horizon, N_INPUTS))
        """(N, 3), the plan of the last solve that succeeded"""
        self._path = STRAIGHT_PATH
        self._preview: CurvaturePreview | None = None
        self._has_plan = False
        self._is_prepared = False

    def plan(
        self,
        state: VehicleState,
        curvature_per_m: float,
        path: PathReference,
        previous: ControlInput,
        preview: CurvaturePreview | None = None,
    ) -> SolveStatus:
        """Status of planning from `state`; on SOLVED, `inputs` holds the plan.

        Args:
            state: the one observed last, if any was.
            curvature_per_m: of the road at the car.
            path: as seen from the car.
            previous: the input of the last period: slew rates and the cost of change start from it.
            preview: of the road ahead; None: its curvature is constant.
        """
        if self._history is not None and not self._history.is_begun:
            self._history.advance(state, previous)
        self._path, self._preview = path, preview

        psi = self._encoder.lift(state, curvature_per_m)
        reference = self._reference.expand(path, state, curvature_per_m, preview)
        if self._tracks_latents:
            reference = self._encoder.lift_batch(reference, curvature_per_m)
        parameters = self._qp.parameters
        parameters.psi[:] = psi
        parameters.curvature_per_m[:] = curvature_per_m
        parameters.previous[:] = previous
        parameters.reference[:] = reference
        self._pedals.update(state.vx_mps - path.v_mps, path.a_mps2)
        if not self._is_prepared:
            self._update_matrices()
        self._qp.update_vectors(self._pedals)
        begun_ns = time.perf_counter_ns()
        status = self._solver.solve()
        self.solve_ns = time.perf_counter_ns() - begun_ns

        self._is_prepared = False
        self._has_plan = status is SolveStatus.SOLVED
        if self._has_plan:
            v = self._solver.solution[: self._qp.scale.size]
            np.multiply(v, self._qp.scale, out=self.inputs.reshape(-1))
        return status

    def prepare(self) -> None:
        """Build the matrices of the next period's QP, around its predicted state.

        Does nothing unless the last `plan` succeeded. The next plan then needs the same time with
        every model (the preparation phase of the real-time iteration: Diehl, Bock and Schlöder,
        2005).
        """
        self._is_prepared = False
        if not self._has_plan:
            return
        parameters, psi = self._qp.parameters, self._qp.parameters.psi
        psi[:] = one_step(self._bundle, psi, psi, self.inputs[0], parameters.curvature_per_m)
        parameters.previous[:] = self.inputs[0]
        parameters.reference[:-1] = parameters.reference[1:]
        self._is_prepared = self._update_matrices()
        self._has_plan = False  # a plan is the nominal trajectory of one period only

    def warm_up(self) -> None:
        """Plan the prepared period at its predicted state, and discard the result.

        Afterwards all code and data are in the processor's caches, and the solver starts from the
        active set of this solution.
        """
        if not self._is_prepared:
            return
        parameters = self._qp.parameters
        state = VehicleState(*parameters.psi[:N_STATES].tolist())
        curvature_per_m = float(parameters.curvature_per_m[0])
        self._reference.expand(self._path, state, curvature_per_m, self._preview)
        self._encoder.lift(state, curvature_per_m)
        self._qp.update_vectors(self._pedals)
        self._solver.solve()

    def observe(self, state: VehicleState, held: ControlInput) -> None:
        """Add `state` to the history; `held` was applied in the period that ended here."""
        if self._history is not None:
            self._history.advance(state, held)

    def forget(self) -> None:
        """Discard the history and the plan: a period or more is missing before the next state."""
        self._has_plan = self._is_prepared = False
        if self._history is not None:
            self._history.forget()

    def resume(self, previous: ControlInput) -> None:
        """Before the first plan after another law made the inputs, the last one `previous`."""
        self._pedals.resume(previous)

    def limit_solve_time(self, budget_ns: int) -> None:
        """Limit the time of a solve.

        Raises:
            ConfigError: a typical solve needs more time than that.
        """
        self.max_iterations = self._solver.limit_solve_time(budget_ns)

    @property
    def iterations(self) -> int:
        return self._solver.iterations

    @property
    def lifted(self) -> Array:
        """psi (n,) that the last plan started from; `prepare` overwrites it."""
        return self._qp.parameters.psi

    def predicted_states(self) -> Array | None:
        """States (N + 1, 6) that the model predicts under `inputs`, the present one first.

        Allocates memory, so the control loop does not call it. None unless the last call was a
        `plan` that succeeded: `prepare` and `forget` discard what the prediction starts from.
        """
        if not self._has_plan:
            return None
        psi, curvature_per_m = self._qp.parameters.psi, self._qp.parameters.curvature_per_m
        W = np.broadcast_to(curvature_per_m, (1, len(self.inputs), 1))
        (states,) = roll_out(self._bundle, psi[None], self.inputs[None], W, N_STATES)
        return self._reference.counted_from_road(states)

    def explain_plan(self) -> PlanExplanation:
        """The last plan explained, for people; its QP is solved once more from a cold start.

        Right after a `plan`. Without a solution its numbers are NaN, and the second one says why.
        """
        program, parameters, n_inputs = self._qp.program, self._qp.parameters, self._qp.scale.size
        horizon, width = parameters.reference.shape
        if not self._has_plan:
            nothing = np.full((horizon + 1, N_STATES), np.nan)
            second = solve_again(program, None, n_inputs)
            inputs = np.full((horizon, N_INPUTS), np.nan)
            return PlanExplanation(inputs, nothing, nothing[1:], (), (), second)
        z = self._solver.solution.copy()
        W = np.broadcast_to(parameters.curvature_per_m, (1, horizon, 1))
        (outputs,) = roll_out(self._bundle, parameters.psi[None], self.inputs[None], W, width)
        corridor = self._corridor and (self._corridor.half_width_m, self._corridor.weight)
        reference = parameters.reference.copy()
        costs = cost_shares(
            self._cost, outputs[1:], reference, self.inputs, parameters.previous, corridor
        )
        return PlanExplanation(
            self.inputs.copy(),
            self._reference.counted_from_road(outputs[:, :N_STATES]),
            reference[:, :N_STATES],
            active_bounds(program, z, n_inputs),
            costs,
            solve_again(program, z, n_inputs),
        )

    def _update_matrices(self) -> bool:
        """True if the matrices at the present parameters make a convex QP."""
        nominal, parameters = self._qp.parameters.nominal_inputs, self._qp.parameters
        if self._has_plan:  # shifted by one period
            nominal[:-1] = self.inputs[1:]
            nominal[-1] = self.inputs[-1]
        else:
            nominal[:] = parameters.previous
        if not self._qp.matrices_vary:
            return True
        open_throttle(nominal, self._pedals)
        self._qp.update_matrices()
        return self._solver.update_matrices()
