"""The same drives with this controller and with nonlinear ones."""

import time
from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np

from benchmarks.peers.entrants.roster import DEFAULT, FAST
from benchmarks.peers.lockstep import drive, plain_config
from benchmarks.peers.nonlinear.dompc import DoMpc
from benchmarks.peers.nonlinear.methods import METHODS, Method
from benchmarks.peers.nonlinear.nmpc import Nmpc, Planning
from benchmarks.peers.nonlinear.outcome import Outcome, Summary, summarise
from benchmarks.peers.nonlinear.shooting import Shooting
from benchmarks.peers.papers_way import OsqpOnStages
from rt_controller.contract.artifact import load_bundle
from rt_controller.contract.bundle import Bundle
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.control.formulation import Formulation, Solving
from rt_controller.control.mpc import Mpc
from rt_controller.control.qp import WITH_SLEW
from rt_controller.control.solver import Solver
from rt_controller.control.solvers import SolverChoice
from rt_controller.control.staged_qp import StagedQp
from rt_controller.control.staged_solver import StagedSolver
from rt_controller.session import WARM_UP_STEPS, shipped_model

Controller = Mpc | Nmpc


class Duel:
    """Everybody who was built, which takes the compiled ones a minute."""

    def __init__(self, model: str, only: Sequence[str] = ()) -> None:
        self._bundle = load_bundle(shipped_model(model))
        builders = _builders(self._bundle)
        self._built = {
            name: build()
            for name, build in builders.items()
            if not only or name in (DEFAULT, *only)
        }

    def drive(self, scenario: str, rounds: int) -> list[Summary]:
        """All of them through the scenario, in turn, several times."""
        outcomes: dict[str, list[Outcome]] = {name: [] for name in self._built}
        order = np.random.default_rng(0)
        for _ in range(rounds):
            for at in order.permutation(len(self._built)):
                name = list(self._built)[at]
                outcomes[name].append(_drive(self._built[name], self._bundle, scenario))
        return [summarise(name, mine, outcomes[DEFAULT]) for name, mine in outcomes.items()]


def _builders(bundle: Bundle) -> dict[str, Callable[[], Controller]]:
    settings = plain_config().mpc
    horizon, cost = settings.horizon, settings.cost()

    def own(choice: SolverChoice) -> Mpc:
        mine = settings.model_copy(update={"solver": choice})
        return Mpc(bundle, horizon, cost, INPUT_LIMITS, mine.features(), mine.solving())

    def nonlinear(planning: Planning) -> Nmpc:
        return Nmpc(planning, horizon, INPUT_LIMITS)

    def shooting(method: Method) -> Callable[[], Controller]:
        return lambda: nonlinear(Shooting(method, horizon, cost, INPUT_LIMITS))

    def with_states(solver: Callable[[StagedQp], Solver]) -> Callable[[], Controller]:
        solving = Solving(Formulation.STAGED, staged=solver)
        return lambda: Mpc(bundle, horizon, cost, INPUT_LIMITS, WITH_SLEW, solving)

    staged = {
        "states in the QP, PIQP": with_states(StagedSolver),
        "states in the QP, OSQP cold": with_states(OsqpOnStages),
    }
    return {
        DEFAULT: lambda: own(SolverChoice.PIQP),
        FAST: lambda: own(SolverChoice.DAQP),
        **(staged if bundle.bilinear is None else {}),
        **{method.name: shooting(method) for method in METHODS},
        "do-mpc, IPOPT": lambda: nonlinear(DoMpc(horizon, cost, INPUT_LIMITS)),
    }


def _drive(controller: Controller, bundle: Bundle, scenario: str) -> Outcome:
    timed = _Timed(controller)
    # The loop asks for nothing but what `_Timed` passes on.
    errors = drive(plain_config(), bundle, cast("Mpc", timed), scenario)
    return Outcome(np.array(timed.plan_us[WARM_UP_STEPS:]), np.array(timed.prepare_us), errors)


class _Timed:
    """A controller with a clock beside it."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.plan_us: list[float] = []
        self.prepare_us: list[float] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._controller, name)

    def plan(self, *given: Any) -> Any:
        begun_ns = time.perf_counter_ns()
        status = self._controller.plan(*given)
        self.plan_us.append((time.perf_counter_ns() - begun_ns) / 1e3)
        return status

    def prepare(self) -> None:
        begun_ns = time.perf_counter_ns()
        self._controller.prepare()
        self.prepare_us.append((time.perf_counter_ns() - begun_ns) / 1e3)

    def rehearse(self) -> None:
        begun_ns = time.perf_counter_ns()
        self._controller.rehearse()
        self.prepare_us[-1] += (time.perf_counter_ns() - begun_ns) / 1e3
