"""Model predictive control of eq. (14): state and path in, planned inputs out."""

import time
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import (
    AT_REST,
    N_INPUTS,
    N_STATES,
    ControlInput,
    CurvaturePreview,
    InputColumn,
    PathReference,
    StateColumn,
    VehicleState,
)
from rt_controller.control.estimator import MOTION_GAIN, Estimator
from rt_controller.control.lift import Encoder, History
from rt_controller.control.pedals import PedalChoice
from rt_controller.control.program import QuadraticProgram, Solver, SolveStatus
from rt_controller.control.qp import CondensedQp
from rt_controller.control.reference import ReferenceHorizon
from rt_controller.control.terms import Corridor, TrackingCost, place_knots
from rt_controller.control.warm_start import open_solver
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import roll_out
from rt_controller.model.validation import require_drivable

INTEGRAL_GAIN, LARGEST_INTEGRAL_M, INTEGRATED_M = 0.005, 0.03, 0.1
"""of the lateral error, in one period; a larger error is not integrated"""
MOST_UNDER_WAY = 16
"""inputs that were sent and may not act yet"""
MOST_NOMINAL_THROTTLE = 0.45
"""the model is linearised at most there: the power of an engine hardly changes beyond, and with no
effect of the throttle in the QP an open one would stay open, or the wheel would do its work"""
STRAIGHT_PATH = PathReference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Mpc:
    """The MPC of eq. (14) with the model of one bundle, everything allocated at start.

    A period is `observe`, `plan`, and, in the time until the next one, `prepare` and `warm_up`.

    Paper: eq. (14).
    """

    def __init__(
        self,
        bundle: Bundle,
        horizon: int,
        cost: TrackingCost,
        corridor: Corridor | None = None,
        open_solver: Callable[[QuadraticProgram], Solver] = open_solver,
        knots: int | None = None,
        disturbance_gain: float = MOTION_GAIN,
    ) -> None:
        """`knots` over `horizon`, as of `place_knots`; `disturbance_gain` of `Estimator`."""
        require_drivable(bundle)
        self._bundle = bundle
        self._encoder = Encoder(bundle)
        rows = self._encoder.history
        self._history = None if rows is None else History(rows)
        self._pedals = PedalChoice()
        self._qp = CondensedQp(bundle, horizon, cost, corridor, knots)
        self._reference = ReferenceHorizon(self._qp.knots)
        self._solver = open_solver(self._qp.program)
        self._knots = np.array([0, *self._qp.knots.ends])
        """stages at which the reference is compared with the prediction"""
        self._estimator = Estimator(bundle, horizon + MOST_UNDER_WAY, disturbance_gain)
        self.solve_ns = 0
        """time of the last solve"""
        self.max_iterations: int | None = None
        """of a solve, where its time is limited"""
        self.inputs = np.zeros((horizon, N_INPUTS))
        """(N, 3), the plan of the last solve that succeeded"""
        self._path = STRAIGHT_PATH
        self._preview: CurvaturePreview | None = None
        self._under_way: Sequence[ControlInput] = ()
        self._integral_m = 0.0
        self._observed = self._estimate = self._planned_from = AT_REST
        self._has_plan = False
        self._is_prepared = False

    def plan(
        self,
        state: VehicleState,
        curvature_per_m: float,
        path: PathReference,
        previous: ControlInput,
        preview: CurvaturePreview | None = None,
        under_way: Sequence[ControlInput] = (),
    ) -> SolveStatus:
        """Status of planning from `state`, the one observed last; SOLVED: `inputs` is the plan.

        Slew rates and the cost of change start from the input `previous` of the last period. The
        plan begins after the inputs `under_way`; without a `preview` the curvature is constant.
        """
        if self._history is not None and not self._history.is_begun:
            self._history.advance(state, previous)
        if state is self._observed:
            state = self._estimate
        self._planned_from = state
        self._path, self._preview, self._under_way = path, preview, under_way

        psi = self._encoder.lift(state, curvature_per_m)
        parameters = self._qp.parameters
        for each in under_way:
            psi = self._estimator.step(psi, each, curvature_per_m)
        parameters.psi[:] = psi
        parameters.curvature_per_m = curvature_per_m
        parameters.previous[:] = previous
        parameters.reference[:] = self._reference.expand(
            path, state, curvature_per_m, preview, len(under_way)
        )
        parameters.reference -= self._deviations(self._knots)
        parameters.reference[:, StateColumn.ey_m] -= self._integrate(state.ey_m - path.c0_m)
        if not self._is_prepared:
            self._update_matrices()
        pedal = self._pedals.pedal
        self._pedals.update(self._qp.needed_mps2(pedal))
        if not self._is_prepared and self._pedals.pedal is not pedal:
            self._update_matrices()  # with the columns of the other pedal
        self._qp.update_vectors(self._pedals)
        begun_ns = time.perf_counter_ns()
        status = self._solver.solve()
        self.solve_ns = time.perf_counter_ns() - begun_ns

        self._is_prepared, self._has_plan = False, status is SolveStatus.SOLVED
        if self._has_plan:
            v = self._solver.solution[: self._qp.scale.size]
            knots = (v * self._qp.scale).reshape(-1, N_INPUTS)
            np.dot(self._qp.interpolation, knots, out=self.inputs)
        return status

    def _deviations(self, stages: NDArray[np.int64]) -> Array:
        """What the disturbance adds to the states that are predicted at some stages."""
        vx_mps, periods = self._planned_from.vx_mps, stages + len(self._under_way)
        return self._estimator.deviations(periods, vx_mps)

    def _integrate(self, error_m: float) -> float:
        """Slow integral of the lateral error: what the disturbance leaves over."""
        if abs(error_m) < INTEGRATED_M:
            changed_m = self._integral_m + INTEGRAL_GAIN * error_m
            self._integral_m = min(max(changed_m, -LARGEST_INTEGRAL_M), LARGEST_INTEGRAL_M)
        return self._integral_m

    def prepare(self) -> None:
        """Build the matrices of the next period's QP around its predicted state, after a plan.

        The next one then needs the same time with every model (the preparation phase of the
        real-time iteration: Diehl, Bock and Schlöder, 2005).
        """
        self._is_prepared = False
        if not self._has_plan:
            return
        parameters, first = self._qp.parameters, ControlInput(*self.inputs[0].tolist())
        curvature_per_m, psi = parameters.curvature_per_m, parameters.psi
        acting = self._under_way[0] if self._under_way else first
        self._estimator.advance(self._encoder.psi, acting, curvature_per_m)
        psi[:] = self._estimator.step(psi, first, curvature_per_m)
        parameters.previous[:] = first
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
        curvature_per_m = parameters.curvature_per_m
        delay = len(self._under_way)
        self._reference.expand(self._path, state, curvature_per_m, self._preview, delay)
        self._encoder.lift(state, curvature_per_m)
        self._qp.update_vectors(self._pedals)
        self._solver.solve()

    def observe(self, state: VehicleState, held: ControlInput) -> None:
        """Filter `state` and add it to the history; `held` was applied until now."""
        self._observed = state
        self._estimate = self._estimator.estimate(state, self._qp.parameters.curvature_per_m)
        if self._history is not None:
            self._history.advance(self._estimate, held)

    def observe_estimate(self, state: VehicleState, held: ControlInput) -> None:
        """The same with a state that is partly estimated, since a signal is faulty.

        What was learned from the faulty signal is discarded, and nothing is learned from it.
        """
        self._estimator.reset()
        self._integral_m = 0.0
        self.observe(state, held)

    def forget(self) -> None:
        """Discard the history and the plan: a period or more is missing before the next state."""
        self._has_plan = self._is_prepared = False
        self._estimator.forget()
        if self._history is not None:
            self._history.forget()

    def reset(self) -> None:
        """Another drive begins: discard all that was learned from the last one."""
        self.forget()
        self._estimator.reset()
        self._integral_m = 0.0

    def assume_steady(
        self, state: VehicleState, curvature_per_m: float, applied: ControlInput
    ) -> None:
        """A drive begins with a car, `state` observed last, that turns steadily with this input."""
        psi = self._encoder.lift(state, curvature_per_m)
        self._estimator.assume_steady(psi, applied, curvature_per_m)

    def resume(self, previous: ControlInput) -> None:
        """Before the first plan after another law made the inputs, the last one `previous`."""
        self._pedals.resume(previous)

    def limit_steering(self, most_rad: float, rate_radps: float) -> None:
        """Plan from now on with a wheel that turns at most so far, and at most at this rate."""
        self._qp.limit_steering(most_rad, rate_radps)

    def limit_solve_time(self, budget_ns: int) -> None:
        """Limit the time of a solve, as `Solver.limit_solve_time`."""
        self.max_iterations = self._solver.limit_solve_time(budget_ns)

    @property
    def iterations(self) -> int:
        return self._solver.iterations

    @property
    def lifted(self) -> Array:
        """psi (n,) of the last state; `warm_up` overwrites it."""
        return self._encoder.psi

    def predicted_states(self) -> Array | None:
        """States (N + 1, 6) that the model predicts under `inputs`, that at their begin first.

        Without the estimated disturbance: a caller may let the model stand in for the car.
        Allocates memory, so the control loop does not call it. None unless the last call was a
        `plan` that succeeded: `prepare` and `forget` discard what the prediction starts from.
        """
        if not self._has_plan:
            return None
        curvature_per_m, delay = self._qp.parameters.curvature_per_m, len(self._under_way)
        reference = ReferenceHorizon(place_knots(len(self.inputs), len(self.inputs)))
        reference.expand(self._path, self._planned_from, curvature_per_m, self._preview, delay)
        W = np.full((1, len(self.inputs), 1), curvature_per_m)
        psi, inputs = self._qp.parameters.psi[None], self.inputs[None]
        # e_y and e_psi are counted from the circle of the curvature at the car.
        (states,) = roll_out(self._bundle, psi, inputs, W, N_STATES)
        return reference.counted_from_road(states)

    def _update_matrices(self) -> bool:
        """True if the matrices at the present parameters make a convex QP."""
        parameters = self._qp.parameters
        knots = parameters.nominal_knots
        if self._has_plan:  # shifted by one period
            following = np.minimum(np.add(self._qp.knots.stages, 1), len(self.inputs) - 1)
            knots[:] = self.inputs[following]
        else:
            knots[:] = parameters.previous
        throttle = knots[:, InputColumn.throttle]
        np.minimum(throttle, MOST_NOMINAL_THROTTLE, out=throttle)
        np.dot(self._qp.interpolation, knots, out=parameters.nominal_inputs)
        self._qp.update_matrices(self._pedals.used_inputs(parameters.previous))
        return not self._qp.matrices_vary or self._solver.update_matrices()
