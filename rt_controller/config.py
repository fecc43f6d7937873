"""What a person may set, with units and bounds; on the command line, in TOML, or not at all."""

import os
from enum import StrEnum
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat

from rt_controller.contract.signals import ControlInput, VehicleState
from rt_controller.contract.timing import HOLD_PLAN_TICKS, PERIOD_MS

if TYPE_CHECKING:
    from rt_controller.control.program import QuadraticProgram
    from rt_controller.control.qp import Features
    from rt_controller.control.solver import Solver
    from rt_controller.control.terms import TrackingCost


class Pace(StrEnum):
    """How fast time goes by."""

    REALTIME = "realtime"
    LOCKSTEP = "lockstep"


class _Settings(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Tolerances(_Settings):
    """Deviations from the reference that cost one unit each; smaller is stricter."""

    vx_mps: PositiveFloat = 1.0
    """longitudinal speed"""
    vy_mps: PositiveFloat = float("inf")
    """lateral speed; inf: do not care"""
    yaw_rate_radps: PositiveFloat = float("inf")
    """yaw rate; inf: do not care"""
    ds_m: PositiveFloat = float("inf")
    """progress in one period; inf: the speed says the same"""
    ey_m: PositiveFloat = 0.15
    """lateral deviation"""
    epsi_deg: PositiveFloat = 1.0
    """heading error"""
    throttle: PositiveFloat = float("inf")
    """size of the throttle input; inf: speed may cost what it costs"""
    brake_n: PositiveFloat = float("inf")
    """size of the brake force"""
    steer_deg: PositiveFloat = float("inf")
    """size of the wheel angle"""
    throttle_change: PositiveFloat = 0.3
    """change of throttle in one period"""
    brake_change_n: PositiveFloat = 45.0
    """change of brake force in one period"""
    steer_change_deg: PositiveFloat = 12.0
    """change of wheel angle in one period"""


class MpcSettings(_Settings):
    """The optimal control problem."""

    horizon: Annotated[int, Field(ge=HOLD_PLAN_TICKS + 1, le=160)] = 20
    """stages of one period each; beyond 0.6 s the path on the bus is extrapolated"""
    terminal_factor: PositiveFloat = 1.0
    """weight of the last stage, in units of the others"""
    latent_weight: Annotated[float, Field(ge=0.0)] = 0.0
    """weight on each latent's distance from the lifted reference"""
    slew_rows: bool = True
    """bound the inputs' changes in the plan too, not just in what is sent"""
    corridor_m: PositiveFloat | None = None
    """how far from the path the plan may be before that costs extra; none: as far as it likes"""
    beyond_corridor_m: PositiveFloat = 0.05
    """how far beyond costs as much as any other tolerated deviation"""
    solver: Literal["piqp", "daqp"] = "piqp"
    """of the QP; daqp needs the extra [daqp]"""
    warm_start: Literal["on", "off"] = "on"
    """try the last active set before piqp"""
    tolerance: Tolerances = Tolerances()

    def features(self) -> "Features":
        """What the QP has beyond the paper's."""
        from rt_controller.control.qp import Features
        from rt_controller.control.terms import Corridor

        corridor = None
        if self.corridor_m is not None:
            corridor = Corridor(self.corridor_m, self.beyond_corridor_m)
        return Features(self.slew_rows, corridor)

    def open_solver(self, program: "QuadraticProgram") -> "Solver":
        """Workspace of the chosen solver on this program.

        Raises:
            MissingExtraError: the solver is not installed.
            ConfigError: the solver refuses the program.
        """
        from rt_controller.control.solver import SolverChoice, open_solver

        return open_solver(program, SolverChoice(self.solver), self.warm_start == "on")

    def cost(self) -> "TrackingCost":
        """The same in SI units, in vector order."""
        from rt_controller.control.terms import TrackingCost

        t = self.tolerance
        return TrackingCost(
            state=VehicleState(
                t.vx_mps, t.vy_mps, t.yaw_rate_radps, t.ds_m, t.ey_m, radians(t.epsi_deg)
            ),
            control=ControlInput(t.throttle, t.brake_n, radians(t.steer_deg)),
            control_change=ControlInput(
                t.throttle_change, t.brake_change_n, radians(t.steer_change_deg)
            ),
            latent_weight=self.latent_weight,
            terminal_factor=self.terminal_factor,
        )


class RealtimeSettings(_Settings):
    """How the loop runs on this machine."""

    priority: Annotated[int, Field(ge=0, le=99)] = 50
    """SCHED_FIFO priority, where the system allows it; 0: do not ask"""
    cpu: Annotated[int, Field(ge=0, lt=os.cpu_count() or 1)] | None = None
    """bind the loop to this core"""
    phase_ms: Annotated[float, Field(ge=0.0, lt=PERIOD_MS)] = 2.0
    """how long after the vehicle's frames each tick is scheduled"""
    prepare_ms: Annotated[float, Field(ge=0.0, lt=PERIOD_MS)] = 4.0
    """how long before each tick its QP is built; from 1 ms on it is rehearsed too; 0: never"""
    solve_budget_ms: Annotated[float, Field(gt=0.0, le=PERIOD_MS)] = 5.0
    """the longest that the solver may take, by what an iteration takes on this machine"""
    deadline_ms: Annotated[float, Field(gt=0.0, le=PERIOD_MS)] = 10.0
    """the latest moment for the command's frame, counted from the scheduled tick"""


class BusSettings(_Settings):
    """Which CAN bus, in python-can's words."""

    interface: str = "virtual"
    channel: str = "rt-controller"
    bitrate: int | None = None
    options: dict[str, str] = {}


class ControllerConfig(_Settings):
    """Everything that one run of the controller depends on."""

    bus: BusSettings = BusSettings()
    model: str | Path | None = None
    """name of a shipped model or folder of a bundle; None: mdk-net"""
    mpc: MpcSettings = MpcSettings()
    realtime: RealtimeSettings = RealtimeSettings()
