"""Drives of the simulated car with the MPC in Python, recorded, and planned again by a planner."""

import time
from math import inf
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.config import ControllerConfig, MpcSettings
from rt_controller.contract.arrays import Array
from rt_controller.contract.car import DEFAULT_CAR
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import (
    N_INPUTS,
    ControlInput,
    CurvaturePreview,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.law import Observation
from rt_controller.control.mpc import MOST_UNDER_WAY, Mpc
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.planner import Planner
from rt_controller.control.program import QuadraticProgram, SolveStatus
from rt_controller.control.warm_start import WarmStartedSolver
from rt_controller.model.bundle import Bundle
from rt_controller.safety.envelope import limit
from rt_controller.simulation import simulate
from sim_bridge.scenario import Scenario

SCENARIOS = (
    ("lane_change_60", 40, 120),
    ("road_course", 200, 160),
    ("slalom", 80, 140),
    ("stop_and_hold", 120, 100),
)
"""name, first recorded period of the MPC, number of them"""
MOST_ITERATIONS = 60
"""of PIQP"""
FEWEST_PERIODS = 40
"""of all drives; a model that is recorded for less does not hold the car"""


class Situation(NamedTuple):
    """What a planner knows in a period, as `mdk_situation`."""

    is_restart: bool
    """the last inputs are of another law, or a period is missing"""
    state: VehicleState
    curvature_per_m: float
    path: PathReference
    preview: CurvaturePreview | None
    applied: ControlInput
    previous: ControlInput
    under_way: tuple[ControlInput, ...]
    most_steer_rad: float


class Planned(NamedTuple):
    """What a planner made of a situation."""

    status: SolveStatus
    inputs: Array
    """(N, 3), the last plan that was solved"""
    iterations: int
    plan_ns: int
    prepare_ns: int


class RecordedDrives(NamedTuple):
    """One row a period; drives follow each other."""

    situations: Array
    """(T, 75), as `in` of mdk_arrays.h"""
    commands: Array
    """(T, 3), limited as they are sent"""
    plans: Array
    """(T, 3 K), the inputs at the knots"""


def record_drives(
    bundle: Bundle, config: ControllerConfig, stages: NDArray[np.int32]
) -> RecordedDrives:
    """What the MPC of the settings saw and planned in parts of the drives of `SCENARIOS`.

    `stages` (K,) of the knots of its plans.

    Raises:
        ArtifactError: the model cannot be driven with, or does not hold the car.
        ConfigError: settings that give no QP.
        MissingExtraError: the simulated car is not compiled.
    """
    mpc, limits = open_exact_mpc(bundle, config.mpc), (bundle.car or DEFAULT_CAR).limits
    rows: list[tuple[Array, Array, Array]] = []
    for name, first, count in SCENARIOS:
        drive = record_drive(bundle, config, name, duration_s=(first + count) * PERIOD_S)
        for i, situation in enumerate(drive[first : first + count]):
            now = situation._replace(is_restart=situation.is_restart or i == 0)
            planned = plan(mpc, now)
            if planned.status is not SolveStatus.SOLVED:
                break
            wanted = ControlInput(*planned.inputs[0].tolist())
            command = limit(wanted, now.previous, limits.with_wheel(now.most_steer_rad))
            rows.append((_numbers(now), np.array(command), planned.inputs[stages].ravel()))
    if len(rows) < FEWEST_PERIODS:
        raise ArtifactError(
            f"The model {bundle.name!r}: expected it to hold the simulated car in short drives, "
            f"found {len(rows)} periods with a plan. Train longer, or on more data."
        )
    return RecordedDrives(*(np.array(column) for column in zip(*rows, strict=True)))


def _numbers(now: Situation) -> Array:
    """(75,), as `in` of mdk_arrays.h."""
    under_way = np.zeros((MOST_UNDER_WAY, N_INPUTS))
    under_way[: len(now.under_way)] = np.reshape(now.under_way, (-1, N_INPUTS))
    constant = np.zeros(len(CurvaturePreview._fields))
    road = (now.curvature_per_m, *now.path, *(now.preview or constant))
    inputs = (*now.applied, *now.previous, len(now.under_way))
    return np.array([now.is_restart, *now.state, *road, *inputs, *under_way.ravel()], dtype=float)


def record_drive(
    bundle: Bundle,
    config: ControllerConfig,
    scenario: str | Path | Scenario,
    *,
    plant: str = "own",
    duration_s: float | None = None,
) -> list[Situation]:
    """What the MPC saw in a drive; the arguments are those of `simulate`."""
    law = RecordedLaw(open_exact_mpc(bundle, config.mpc))
    simulate(
        scenario, controller=law, model=bundle, plant=plant, config=config, duration_s=duration_s
    )
    return law.situations


def plan(planner: Planner, now: Situation) -> Planned:
    """The plan for a situation, which follows on the last one unless it is a restart."""
    if now.is_restart:
        planner.reset()
        planner.resume(now.previous)
    x_0 = planner.observer.observe(now.state, now.applied)
    planner.limit_steering(now.most_steer_rad, inf)
    begun_ns = time.perf_counter_ns()
    status = planner.plan(
        x_0, now.curvature_per_m, now.path, now.previous, now.preview, now.under_way
    )
    planned_ns = time.perf_counter_ns()
    inputs, iterations = planner.inputs.copy(), planner.iterations
    prepared_ns = time.perf_counter_ns()
    planner.prepare()
    prepare_ns = time.perf_counter_ns() - prepared_ns
    return Planned(status, inputs, iterations, planned_ns - begun_ns, prepare_ns)


def open_exact_mpc(bundle: Bundle, settings: MpcSettings) -> Mpc:
    """The MPC of these settings with an exact solution of each QP.

    The C code solves exactly, and a difference of one plan is found in the following ones too.

    Raises:
        ConfigError: settings that give no QP.
    """

    def open_solver(program: QuadraticProgram) -> WarmStartedSolver:
        return WarmStartedSolver(program, PiqpSolver(program, MOST_ITERATIONS, is_exact=True))

    settings = settings.for_model(bundle)
    cost, gain = settings.cost(), settings.disturbance_gain
    return Mpc(bundle, settings.horizon, cost, None, open_solver, settings.knots, gain)


class RecordedLaw:
    """A planner as a control law that keeps what it saw."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._acted: list[ControlInput] = []
        self._is_restart = True
        self.situations: list[Situation] = []

    def reset(self) -> None:
        """The next observation does not follow on the last one."""
        self._is_restart = True

    def control(self, now: Observation) -> ControlInput:
        """The first input of the plan; without one, the last input."""
        if self._is_restart:
            self._acted.clear()
        self._acted.append(now.previous)
        situation = Situation(
            is_restart=self._is_restart,
            applied=self._acted[max(len(self._acted) - 1 - len(now.under_way), 0)],
            **now._asdict(),
        )
        self.situations.append(situation)
        planned = plan(self._planner, situation)
        self._is_restart = planned.status is not SolveStatus.SOLVED
        return now.previous if self._is_restart else ControlInput(*planned.inputs[0].tolist())
