"""Model predictive control of eq. (14): state and path in, planned inputs out."""

import time
from collections.abc import Callable, Sequence

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import (
    AT_REST,
    N_INPUTS,
    N_STATES,
    ControlInput,
    CurvaturePreview,
    InputColumn,
    PathReference,
    VehicleState,
)
from rt_controller.control.eq14 import CondensedQp, Corridor, TrackingCost
from rt_controller.control.estimator import MOTION_GAIN
from rt_controller.control.knots import place_knots
from rt_controller.control.observer import StateObserver
from rt_controller.control.pedals import PedalChoice
from rt_controller.control.program import QuadraticProgram, Solver, SolveStatus
from rt_controller.control.reference import ReferenceHorizon
from rt_controller.control.warm_start import open_solver
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import roll_out
from rt_controller.model.roll_outs import OneStep
from rt_controller.model.validation import require_drivable

MOST_UNDER_WAY = 16
"""inputs that were sent and may not act yet"""
MOST_NOMINAL_THROTTLE = 0.45
"""the model is linearised at most there: the power of an engine hardly changes beyond, and with no
effect of the throttle in the QP an open one would stay open, or the wheel would do its work"""
STRAIGHT_PATH = PathReference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Mpc:
    """The MPC of eq. (14) with the model of one bundle, everything allocated at start.

    A period is `x_0 = observer.observe(...)`, `plan(x_0, ...)`, and, in the time until the next
    one, `prepare` and `warm_up`.

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
        step: OneStep | None = None,
    ) -> None:
        """`knots` over `horizon`, as of `place_knots`; gain and `step` of `Estimator`."""
        require_drivable(bundle)
        self._bundle = bundle
        self.name = f"{bundle.name} {bundle.sha256[:8]}"
        self.observer = StateObserver(bundle, horizon + MOST_UNDER_WAY, disturbance_gain, step)
        self._pedals = PedalChoice()
        self._qp = CondensedQp(bundle, horizon, cost, corridor, knots)
        self._reference = ReferenceHorizon(self._qp.knots)
        self._solver = open_solver(self._qp.program)
        self._knots = np.array([0, *self._qp.knots.ends])
        """stages at which the reference is compared with the prediction"""
        self.solve_ns = 0
        """time of the last solve"""
        self.max_iterations: int | None = None
        """of a solve, where its time is limited"""
        self.inputs = np.zeros((horizon, N_INPUTS))
        """(N, 3), the plan of the last solve that succeeded"""
        self._x_0 = AT_REST
        self._path = STRAIGHT_PATH
        self._preview: CurvaturePreview | None = None
        self._under_way: Sequence[ControlInput] = ()
        self._has_plan = False
        self._is_prepared = False

    def plan(
        self,
        x_0: VehicleState,
        curvature_per_m: float,
        path: PathReference,
        previous: ControlInput,
        preview: CurvaturePreview | None = None,
        under_way: Sequence[ControlInput] = (),
    ) -> SolveStatus:
        """Status of planning from the state `x_0` of `observe`; SOLVED: `inputs` is the plan.

        Slew rates and the cost of change start from the input `previous` of the last period. The
        plan begins after the inputs `under_way`; without a `preview` the curvature is constant.
        """
        qp = self._qp
        self._x_0, self._path, self._preview, self._under_way = x_0, path, preview, under_way
        psi = self.observer.after(self.observer.lift(x_0, curvature_per_m), under_way)
        qp.psi_0[:], qp.kappa = psi, curvature_per_m
        qp.u_prev[:] = self.observer.steering.of_model(previous)
        delay = len(under_way)
        qp.x_r[:] = self._reference.expand(path, x_0, curvature_per_m, preview, delay)
        qp.x_r -= self.observer.estimator.deviations(self._knots + delay, x_0.vx_mps)
        if not self._is_prepared:
            self._update_matrices()
        qp.update_vectors()
        self._pedals.update(qp.needed_mps2(self._pedals.pedal))
        qp.update_bounds(self._pedals)
        begun_ns = time.perf_counter_ns()
        status = self._solver.solve()
        self.solve_ns = time.perf_counter_ns() - begun_ns

        self._is_prepared, self._has_plan = False, status is SolveStatus.SOLVED
        if self._has_plan:
            v = self._solver.solution[: qp.scale.size]
            np.dot(qp.T, (v * qp.scale).reshape(-1, N_INPUTS), out=self.inputs)
            self.inputs[:, InputColumn.steer_rad] /= self.observer.steering.value
        return status

    def prepare(self) -> None:
        """Build the matrices of the next period's QP around its predicted state, after a plan.

        The next one then needs the same time with every model (the preparation phase of the
        real-time iteration: Diehl, Bock and Schlöder, 2005).
        """
        self._is_prepared = False
        if not self._has_plan:
            return
        qp, first = self._qp, ControlInput(*self.inputs[0].tolist())
        acting = self._under_way[0] if self._under_way else first
        self.observer.advance(acting)
        qp.psi_0[:] = self.observer.after(qp.psi_0, (first,))
        qp.u_prev[:] = self.observer.steering.of_model(first)
        self._is_prepared = self._update_matrices()
        self._has_plan = False  # a plan is the nominal trajectory of one period only

    def warm_up(self) -> None:
        """Plan the prepared period at its predicted state, and discard the result.

        Afterwards all code and data are in the processor's caches, and the solver starts from the
        active set of this solution.
        """
        if not self._is_prepared:
            return
        qp = self._qp
        x_0 = VehicleState(*qp.psi_0[:N_STATES].tolist())
        self._reference.expand(self._path, x_0, qp.kappa, self._preview, len(self._under_way))
        self.observer.lift(x_0, qp.kappa)
        qp.update_vectors()
        qp.update_bounds(self._pedals)
        self._solver.solve()

    def forget(self) -> None:
        """Discard the history and the plan: a period or more is missing before the next state."""
        self._has_plan = self._is_prepared = False
        self.observer.forget()

    def reset(self) -> None:
        """Another drive begins: discard all that was learned from the last one."""
        self.forget()
        self.observer.reset()

    def resume(self, previous: ControlInput) -> None:
        """Before the first plan after another law made the inputs, the last one `previous`."""
        self._pedals.resume(previous)

    def limit_steering(self, most_rad: float, rate_radps: float) -> None:
        """Plan from now on with a wheel that turns at most so far, and at most at this rate."""
        self._qp.limit_steering(most_rad, rate_radps, self.observer.steering.value)

    def limit_solve_time(self, budget_ns: int) -> None:
        """Limit the time of a solve, as `Solver.limit_solve_time`."""
        self.max_iterations = self._solver.limit_solve_time(budget_ns)

    @property
    def iterations(self) -> int:
        return self._solver.iterations

    @property
    def periods_under_way(self) -> int:
        """From the state of the last `plan` to the begin of its plan."""
        return len(self._under_way)

    def predicted_states(self) -> Array | None:
        """States (N + 1, 6) that the model predicts under `inputs`, that at their begin first.

        Without the estimated disturbance: a caller may let the model stand in for the car.
        Allocates memory, so the control loop does not call it. None unless the last call was a
        `plan` that succeeded: `prepare` and `forget` discard what the prediction starts from.
        """
        if not self._has_plan:
            return None
        return predict_states(
            self._bundle,
            self._qp.psi_0,
            self.inputs * (1.0, 1.0, self.observer.steering.value),
            self._x_0,
            self._qp.kappa,
            self._path,
            self._preview,
            len(self._under_way),
        )

    def _update_matrices(self) -> bool:
        """True if the matrices along the last plan make a convex QP."""
        qp = self._qp
        if self._has_plan:  # shifted by one period
            following = np.minimum(np.add(qp.knots.stages, 1), len(self.inputs) - 1)
            qp.u_nominal[:] = self.inputs[following]
            qp.u_nominal[:, InputColumn.steer_rad] *= self.observer.steering.value
        else:
            qp.u_nominal[:] = qp.u_prev
        throttle = qp.u_nominal[:, InputColumn.throttle]
        np.minimum(throttle, MOST_NOMINAL_THROTTLE, out=throttle)
        qp.update_matrices()
        return not qp.matrices_vary or self._solver.update_matrices()


def predict_states(
    bundle: Bundle,
    psi_0: Array,
    inputs: Array,
    x_0: VehicleState,
    curvature_per_m: float,
    path: PathReference,
    preview: CurvaturePreview | None,
    delay: int,
) -> Array:
    """States (N + 1, 6) from psi_0 (n,) under inputs (N, 3), which begin `delay` periods after x_0.

    Allocates memory.
    """
    horizon = len(inputs)
    reference = ReferenceHorizon(place_knots(horizon, horizon))
    reference.expand(path, x_0, curvature_per_m, preview, delay)
    W = np.full((1, horizon, 1), curvature_per_m)
    # e_y and e_psi are counted from the circle of the curvature at the car.
    (states,) = roll_out(bundle, psi_0[None], inputs[None], W, N_STATES)
    return reference.counted_from_road(states)
