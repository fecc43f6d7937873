"""The model predictive controller: where the car is and should be in, a plan of inputs out."""

import time

import numpy as np

from rt_controller.contract.bundle import Bundle
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.fitness import require_drivable
from rt_controller.contract.limits import InputLimits
from rt_controller.contract.schema import N_STATES
from rt_controller.contract.signals import ControlInput, PathReference, VehicleState
from rt_controller.control.constraints import N_INPUTS
from rt_controller.control.cost import TrackingCost
from rt_controller.control.formulation import AS_SHIPPED, Solving, formulate
from rt_controller.control.history import History
from rt_controller.control.lift import Encoder
from rt_controller.control.pedals import PedalChoice
from rt_controller.control.prediction import one_step
from rt_controller.control.qp import WITH_SLEW, Features
from rt_controller.control.reference import ReferenceHorizon
from rt_controller.control.solver import SolveStatus

STRAIGHT_AHEAD = PathReference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Mpc:
    """Eq. (14) with one bundle's model, everything allocated at start.

    Raises:
        ArtifactError: the bundle is not of this car, or cannot be lifted with or planned with.
        ConfigError: latents shall be tracked whose reference is not defined.

    Paper: eq. (14).
    """

    def __init__(
        self,
        bundle: Bundle,
        horizon: int,
        cost: TrackingCost,
        limits: InputLimits,
        features: Features = WITH_SLEW,
        solving: Solving = AS_SHIPPED,
    ) -> None:
        require_drivable(bundle)
        _require_liftable_reference(bundle, cost)
        self._bundle = bundle
        self._encoder = Encoder(bundle)
        past = self._encoder.history
        self._history = None if past is None else History(past)
        self._qp, self._solver = formulate(bundle, horizon, cost, limits, features, solving)
        self._reference = ReferenceHorizon(horizon)
        self._tracks_latents = self._qp.situation.reference.shape[1] > N_STATES
        self._pedals = PedalChoice()
        self.solve_ns = 0
        """time of the last solve, vectors in to solution out"""
        self.inputs = np.zeros((horizon, N_INPUTS))
        """(N, 3), the plan of the last solve that succeeded"""
        self._path = STRAIGHT_AHEAD
        self._has_plan = False
        self._is_prepared = False

    @property
    def iterations(self) -> int:
        """Iterations of the last solve."""
        return self._solver.iterations

    def bound(self, budget_ns: int) -> None:
        """Never solve for much longer than this.

        Raises:
            ConfigError: a usual solve would not be done by then.
        """
        self._solver.bound(budget_ns)

    def observe(self, state: VehicleState, held: ControlInput) -> None:
        """The car is at `state`, and `held` was in force for the period that ended here."""
        if self._history is not None:
            self._history.advance(state, held)

    def forget(self) -> None:
        """What was observed is not the past of the next state: a period or more is missing."""
        self._has_plan = self._is_prepared = False
        if self._history is not None:
            self._history.forget()

    def plan(
        self,
        state: VehicleState,
        curvature_per_m: float,
        path: PathReference,
        previous: ControlInput,
    ) -> SolveStatus:
        """How planning from here ended; on SOLVED, `inputs` holds the plan.

        `state` is the one observed last, if any was. `previous` is the input of the last period:
        slew rates and the cost of change start there.
        """
        if self._history is not None and not self._history.is_begun:
            self._history.advance(state, previous)
        self._path = path
        reference = self._reference.expand(path, state, curvature_per_m)
        now = self._qp.situation
        now.psi[:] = self._encoder.lift(state, curvature_per_m)
        now.road[:] = curvature_per_m
        now.previous[:] = previous
        now.reference[:] = (
            self._encoder.lift_batch(reference, curvature_per_m)
            if self._tracks_latents
            else reference
        )
        if not self._is_prepared:
            self._expect()
            self._build()
        self._pedals.update(state.vx_mps - path.v_mps, path.a_mps2)
        self._qp.aim(self._pedals)

        begun_ns = time.perf_counter_ns()
        status = self._solver.solve()
        self.solve_ns = time.perf_counter_ns() - begun_ns
        self._is_prepared = False
        self._has_plan = status is SolveStatus.SOLVED
        if self._has_plan:
            planned = self._solver.solution[: self._qp.scale.size]
            np.multiply(planned, self._qp.scale, out=self.inputs.reshape(-1))
        return status

    def prepare(self) -> None:
        """Build the next tick's QP as it is expected; after a plan, else nothing.

        The matrices serve the next plan, so what it waits for once its state is known is the same
        for every model (the preparation phase of the real-time iteration: Diehl, Bock and
        Schlöder, 2005).
        """
        self._is_prepared = False
        if not self._has_plan:
            return
        now = self._qp.situation
        applied, curvature_per_m = self.inputs[0], float(now.road[0])
        now.psi[:] = one_step(self._bundle, now.psi, applied, curvature_per_m)
        now.previous[:] = applied
        now.reference[:-1] = now.reference[1:]
        self._expect()
        self._is_prepared = self._build()
        self._has_plan = False  # it serves for one tick

    def rehearse(self) -> None:
        """Plan the tick that was prepared, where it is expected; what comes out is thrown away.

        All code and data have just been touched then, and the solver starts from the active set
        of this solution.
        """
        if not self._is_prepared:
            return
        now = self._qp.situation
        state, curvature_per_m = VehicleState(*now.psi[:N_STATES].tolist()), float(now.road[0])
        self._reference.expand(self._path, state, curvature_per_m)
        self._encoder.lift(state, curvature_per_m)
        self._qp.aim(self._pedals)
        self._solver.solve()

    def _expect(self) -> None:
        """What the inputs will be about: the last plan, one period on, or no change at all."""
        now = self._qp.situation
        if self._has_plan:
            now.expected[:-1] = self.inputs[1:]
            now.expected[-1] = self.inputs[-1]
        else:
            now.expected[:] = now.previous

    def _build(self) -> bool:
        """The matrices around the situation as it stands; False if they make no convex QP."""
        if not self._qp.renews:
            return True
        self._qp.prepare()
        return self._solver.renew()


def _require_liftable_reference(bundle: Bundle, cost: TrackingCost) -> None:
    if cost.latent_weight > 0.0 and bundle.lift.sees_history:
        raise ConfigError(
            f"The model {bundle.name!r} lifts a state together with its past, and a reference "
            f"state has none: expected --mpc.latent-weight 0, found {cost.latent_weight:g}. Leave "
            f"the weight at 0, or choose a --model whose lift sees no history."
        )
