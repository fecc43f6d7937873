"""Drives of the simulated car with the MPC in Python, as test vectors of the law in C."""

from collections.abc import Callable
from functools import partial
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.config import ControllerConfig, MpcSettings
from rt_controller.contract.arrays import Array
from rt_controller.contract.car import DEFAULT_CAR
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import N_INPUTS, ControlInput
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.law import Observation
from rt_controller.control.mpc import MOST_UNDER_WAY, Mpc
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.program import QuadraticProgram, SolveStatus
from rt_controller.control.warm_start import ActiveSetIteration
from rt_controller.model.bundle import Bundle
from rt_controller.safety.envelope import limit
from rt_controller.simulation import simulate

SCENARIOS = (
    ("lane_change_60", 40, 120),
    ("road_course", 200, 160),
    ("slalom", 80, 140),
    ("stop_and_hold", 120, 100),
)
"""name, first recorded period of the MPC, number of them"""
MAX_ROUNDS = 20
MOST_ITERATIONS = 60
"""of PIQP"""
FEWEST_PERIODS = 40
"""of all drives; a model that is recorded for less does not hold the car"""


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
    open_mpc = partial(open_exact_mpc, bundle, config.mpc)
    rows: list[tuple[Array, Array, Array]] = []
    for name, first, count in SCENARIOS:
        law = _RecordedLaw(open_mpc, bundle, stages, first, count)
        duration_s = (first + count) * PERIOD_S
        simulate(name, controller=law, model=bundle, config=config, duration_s=duration_s)
        rows += law.rows
    if len(rows) < FEWEST_PERIODS:
        raise ArtifactError(
            f"The model {bundle.name!r}: expected it to hold the simulated car in short drives, "
            f"found {len(rows)} periods with a plan. Train longer, or on more data."
        )
    return RecordedDrives(*(np.array(column) for column in zip(*rows, strict=True)))


def open_exact_mpc(bundle: Bundle, settings: MpcSettings) -> Mpc:
    """The MPC of these settings with an exact solution of each QP.

    Raises:
        ConfigError: settings that give no QP.
    """
    settings = settings.for_model(bundle)
    cost, gain = settings.cost(), settings.disturbance_gain
    return Mpc(bundle, settings.horizon, cost, None, _ExactSolver, settings.knots, gain)


class _ExactSolver:
    """The exact solution of the bounds that are active in a solution of PIQP.

    The C code solves exactly, and a difference of one plan is found in the following ones too.
    """

    def __init__(self, program: QuadraticProgram) -> None:
        self._piqp = PiqpSolver(program, MOST_ITERATIONS, is_exact=True)
        self._active_set = ActiveSetIteration(program)
        self.solution, self.iterations = self._piqp.solution.copy(), 0
        self.limit_solve_time = self._piqp.limit_solve_time

    def update_matrices(self) -> bool:
        return self._piqp.update_matrices() and self._active_set.update_matrices()

    def solve(self) -> SolveStatus:
        """As `Solver.solve`."""
        status = self._piqp.solve()
        if status is SolveStatus.SOLVED:
            self._active_set.start_from(*self._piqp.active_bounds())
            exact = self._active_set.solve(MAX_ROUNDS)
            self.solution[:] = self._piqp.solution if exact is None else exact
        return status


class _RecordedLaw:
    """The MPC as a control law; a new one begins where the recording begins."""

    def __init__(
        self,
        open_mpc: Callable[[], Mpc],
        bundle: Bundle,
        stages: NDArray[np.int32],
        first: int,
        count: int,
    ) -> None:
        self._open_mpc, self._mpc = open_mpc, open_mpc()
        self._first, self._last = first, first + count
        self._limits = (bundle.car or DEFAULT_CAR).limits
        self._stages = stages
        self._acted: list[ControlInput] = []
        self._period = 0
        self._is_restart = True
        self.rows: list[tuple[Array, Array, Array]] = []

    def reset(self) -> None:
        """The next observation does not follow on the last one."""
        self._is_restart = True

    def control(self, now: Observation) -> ControlInput:
        """The first input of the plan."""
        is_restart = self._is_restart or self._period == self._first
        if is_restart:
            self._mpc = self._open_mpc()
            self._mpc.resume(now.previous)
            self._acted.clear()
        mpc = self._mpc
        self._acted.append(now.previous)
        delay = len(now.under_way)
        applied = self._acted[max(len(self._acted) - 1 - delay, 0)]
        x_0 = mpc.observer.observe(now.state, applied)
        mpc.limit_steering(now.most_steer_rad, inf)
        status = mpc.plan(
            x_0, now.curvature_per_m, now.path, now.previous, now.preview, now.under_way
        )
        self._is_restart = status is not SolveStatus.SOLVED
        if self._is_restart:
            raise ArithmeticError(f"no plan: {status.name}")
        wanted = ControlInput(*mpc.inputs[0].tolist())
        if self._first <= self._period < self._last:
            limits = self._limits.with_wheel(now.most_steer_rad)
            under_way = np.zeros((MOST_UNDER_WAY, N_INPUTS))
            under_way[:delay] = np.reshape(now.under_way, (delay, N_INPUTS))
            situation = [
                *(float(is_restart), *now.state, now.curvature_per_m, *now.path, *now.preview),
                *(*applied, *now.previous, float(delay), *under_way.ravel()),
            ]
            command = limit(wanted, now.previous, limits)
            plan = mpc.inputs[self._stages].ravel()
            self.rows.append((np.array(situation), np.array(command), plan))
        self._period += 1
        mpc.prepare()
        return wanted
