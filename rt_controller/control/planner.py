"""What makes the inputs of a drive: the part of a control step that can be exchanged."""

from collections.abc import Sequence
from typing import Protocol

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import (
    ControlInput,
    CurvaturePreview,
    PathReference,
    VehicleState,
)
from rt_controller.control.program import SolveStatus


class Observer(Protocol):
    """What the loop needs of `StateObserver`."""

    @property
    def psi(self) -> Array:
        """(n,), the state that was lifted last."""

    def observe(self, state: VehicleState, held: ControlInput) -> VehicleState:
        """x_0: the filtered state; `held` was applied until now."""

    def observe_estimate(self, state: VehicleState, held: ControlInput) -> VehicleState:
        """The same with a state that is partly estimated, since a signal is faulty."""

    def assume_steady(
        self, state: VehicleState, curvature_per_m: float, applied: ControlInput
    ) -> None:
        """A drive begins with a car that turns steadily with this input."""


class Planner(Protocol):
    """From the state of a period and the path to planned inputs.

    `Mpc`, the same law in C, and `LawPlanner`.
    """

    name: str
    """for people: of the model with the first digits of its hash, or of the law"""
    inputs: Array
    """(N, 3), the last plan that succeeded; its first row is for the period of `plan`"""
    solve_ns: int
    """time of the last solve"""
    max_iterations: int | None
    """of a solve, where its time is limited"""

    @property
    def observer(self) -> Observer:
        """Of the model that the checks predict with."""

    @property
    def iterations(self) -> int:
        """Of the last solve."""

    @property
    def periods_under_way(self) -> int:
        """From the state of the last `plan` to the begin of its plan."""

    def plan(
        self,
        x_0: VehicleState,
        curvature_per_m: float,
        path: PathReference,
        previous: ControlInput,
        preview: CurvaturePreview | None = None,
        under_way: Sequence[ControlInput] = (),
    ) -> SolveStatus:
        """As `Mpc.plan`."""

    def prepare(self) -> None:
        """After a plan: do the work of the next one that does not need its state."""

    def warm_up(self) -> None:
        """Dry-run the next plan."""

    def forget(self) -> None:
        """A period or more is missing before the next state."""

    def reset(self) -> None:
        """Another drive begins."""

    def resume(self, previous: ControlInput) -> None:
        """Before the first plan after another law made the inputs, the last one `previous`."""

    def limit_steering(self, most_rad: float, rate_radps: float) -> None:
        """Plan from now on with a wheel that turns at most so far, and at most at this rate."""

    def limit_solve_time(self, budget_ns: int) -> None:
        """Limit the time of a solve."""

    def predicted_states(self) -> Array | None:
        """States (N + 1, 6) that are predicted under `inputs`; None: nothing is predicted."""
