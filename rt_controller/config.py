"""What a person may set, with units and bounds; on the command line, in TOML, or not at all."""

import os
from enum import StrEnum
from functools import partial
from math import radians
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import ControlInput, VehicleState
from rt_controller.contract.timing import HOLD_PLAN_TICKS
from rt_controller.control.corridor import Corridor
from rt_controller.control.cost import TrackingCost
from rt_controller.control.formulation import Formulation, Solving
from rt_controller.control.qp import Features
from rt_controller.control.solvers import SolverChoice, open_solver


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
    """stages of 25 ms; the path on the bus is true for the first 24 and extrapolated beyond"""
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
    formulation: Formulation = Formulation.AUTO
    """inputs only, or with the states too; the faster one unless said otherwise"""
    solver: SolverChoice = SolverChoice.PIQP
    """of the QP; daqp needs the extra [daqp]"""
    warm_start: Literal["on", "off"] = "on"
    """try the last active set before piqp"""
    tolerance: Tolerances = Tolerances()

    def features(self) -> Features:
        """What the QP has beyond the paper's."""
        corridor = None
        if self.corridor_m is not None:
            corridor = Corridor(self.corridor_m, self.beyond_corridor_m)
        return Features(self.slew_rows, corridor)

    def solving(self) -> Solving:
        """Who solves which form; only PIQP takes stages, so only with it is there a choice.

        Raises:
            ConfigError: another solver shall take them.
        """
        formulation = self.formulation
        if self.solver is not SolverChoice.PIQP:
            if formulation is Formulation.STAGED:
                raise ConfigError(
                    f"--mpc.formulation staged: expected the solver piqp, found "
                    f"{self.solver.value}."
                )
            formulation = Formulation.CONDENSED
        is_warm = self.warm_start == "on"
        return Solving(formulation, partial(open_solver, choice=self.solver, warm_start=is_warm))

    def cost(self) -> TrackingCost:
        """The same in SI units, in vector order."""
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
    phase_ms: Annotated[float, Field(ge=0.0, lt=25.0)] = 2.0
    """how long after the vehicle's frames each tick is scheduled"""
    prepare_ms: Annotated[float, Field(ge=0.0, lt=25.0)] = 4.0
    """how long before each tick its QP is built; from 1 ms on it is rehearsed too; 0: never"""
    solve_budget_ms: Annotated[float, Field(gt=0.0, le=25.0)] = 5.0
    """the longest that the solver may take, by what an iteration takes on this machine"""
    deadline_ms: Annotated[float, Field(gt=0.0, le=25.0)] = 10.0
    """the latest moment for the command's frame, counted from the scheduled tick"""


class BusSettings(_Settings):
    """Which CAN bus, in python-can's words."""

    interface: str = "virtual"
    channel: str = "rt-controller"
    bitrate: int | None = None
    options: dict[str, str] = {}


class CarSettings(_Settings):
    """Which car the virtual bus brings along, and what it drives."""

    scenario: str = "double_lane_change"
    """a shipped scenario, or the path of a .toml file"""
    plant: str = "own"
    """own, fmu:FILE.fmu or commonroad:NUMBER"""
    plant_mapping: Path | None = None
    """of an FMU's variables to the contract; default: the file beside the FMU"""
    car: str | None = None
    """the own car's parameters: a shipped name, or the path of a .toml file"""
    friction: float | None = None
    """of the road, 1 being the road of the tyre's test; default: the scenario's"""
    friction_right: float | None = None
    """of the road under the own car's right wheels, where that is another"""


class ControllerConfig(_Settings):
    """Everything that one run of the controller depends on."""

    bus: BusSettings = BusSettings()
    model: Path | None = None
    """folder of a model bundle; None: the one that ships"""
    mpc: MpcSettings = MpcSettings()
    realtime: RealtimeSettings = RealtimeSettings()
