"""How eq. (14) is posed: over the inputs alone, or with the states of every stage."""

from collections.abc import Callable
from enum import StrEnum
from typing import NamedTuple, Protocol

from rt_controller.contract.bundle import Array, Bundle
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import InputLimits
from rt_controller.control.constraints import N_INPUTS
from rt_controller.control.cost import TrackingCost
from rt_controller.control.objective import Situation
from rt_controller.control.pedals import PedalChoice
from rt_controller.control.program import QuadraticProgram
from rt_controller.control.qp import CondensedQp, Features
from rt_controller.control.solver import Solver
from rt_controller.control.solvers import open_solver
from rt_controller.control.staged_qp import StagedQp
from rt_controller.control.staged_solver import StagedSolver

EVEN_HORIZON, EVEN_SIZE, GROWTH = 40.0, 9.0, 1.2
"""six states and three inputs are solved equally fast both ways over 40 stages; more states move
that as this power of the size of a stage. Decision 018; measured by benchmarks.growth"""


class Formulation(StrEnum):
    """By name, as on the command line."""

    AUTO = "auto"
    """the faster one"""
    CONDENSED = "condensed"
    """inputs only: the size does not depend on the model"""
    STAGED = "staged"
    """with the states: the time grows with the horizon, not with its cube"""


class Problem(Protocol):
    """What the controller needs to know of a QP."""

    situation: Situation
    scale: Array
    """(nv,), the range of each input"""
    renews: bool
    """whether its matrices may change"""

    def prepare(self) -> None:
        """Make the matrices those of the situation as it stands."""
        ...

    def aim(self, pedals: PedalChoice) -> None:
        """Make the vectors those of the situation as it stands."""
        ...


class Solving(NamedTuple):
    """Which form is wanted, and who solves it."""

    formulation: Formulation = Formulation.AUTO
    condensed: Callable[[QuadraticProgram], Solver] = open_solver
    staged: Callable[[StagedQp], Solver] = StagedSolver


AS_SHIPPED = Solving()


def formulate(
    bundle: Bundle,
    horizon: int,
    cost: TrackingCost,
    limits: InputLimits,
    features: Features,
    solving: Solving,
) -> tuple[Problem, Solver]:
    """The problem and its solver, whose solution begins with the inputs.

    Raises:
        ArtifactError: the bundle's model makes the problem non-convex or not finite.
        ConfigError: stages are wanted for a model whose input matrix changes.
    """
    wanted = solving.formulation
    if wanted is Formulation.STAGED and bundle.bilinear is not None:
        raise ConfigError(
            f"The model {bundle.name!r} has an input matrix that follows the state: expected "
            f"--mpc.formulation condensed, found staged."
        )
    if wanted is Formulation.STAGED or (
        wanted is Formulation.AUTO and prefers_stages(bundle, horizon)
    ):
        staged = StagedQp(bundle, horizon, cost, limits, features)
        return staged, solving.staged(staged)
    condensed = CondensedQp(bundle, horizon, cost, limits, features)
    return condensed, solving.condensed(condensed.program)


def prefers_stages(bundle: Bundle, horizon: int) -> bool:
    """Whether PIQP, from nothing, solves the QP faster with the states in it."""
    size = bundle.n_observables + N_INPUTS
    even = EVEN_HORIZON * (size / EVEN_SIZE) ** GROWTH
    return bundle.bilinear is None and horizon > even
