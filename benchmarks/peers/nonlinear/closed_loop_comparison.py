"""The same closed-loop drives with this controller and with nonlinear ones."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, cast

import numpy as np
import pandas as pd

from benchmarks.lockstep import drive_scenario
from benchmarks.peers.nonlinear.formulations import TRACKED, NmpcParameters, period_function
from benchmarks.peers.nonlinear.solvers import METHODS, CasadiSolver, DompcSolver, Method
from benchmarks.peers.solvers.registry import DEFAULT
from benchmarks.tables import percentiles, summarise, timed
from rt_controller.config import MpcSettings
from rt_controller.contract.arrays import Array
from rt_controller.contract.model.artifact import load_bundle, shipped_model
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.schema import N_INPUTS
from rt_controller.contract.signals import (
    ControlInput,
    CurvaturePreview,
    PathReference,
    VehicleState,
)
from rt_controller.control.knots import place_knots
from rt_controller.control.mpc import Mpc
from rt_controller.control.pedals import PedalChoice, limit_pedals
from rt_controller.control.reference import ReferenceHorizon
from rt_controller.control.solver import SolveStatus
from rt_controller.control.terms import constrain_inputs
from rt_controller.planner import WARM_UP_STEPS, build_mpc
from rt_controller.report.table import Column


class Nmpc:
    """References, pedals and limits of the controller, with another model and solver."""

    iterations = 0
    solve_ns = 0

    def __init__(self, solver: CasadiSolver | DompcSolver, horizon: int) -> None:
        self._solver = solver
        self._bounds = constrain_inputs(place_knots(1, 1))
        self._periods = np.arange(1, horizon + 1)
        self._upper = np.tile(self._bounds.upper, (horizon, 1))
        self._period = period_function(self._bounds.scale)
        self._reference = ReferenceHorizon(place_knots(horizon, horizon))
        self._pedals = PedalChoice()
        self.inputs = np.zeros((horizon, N_INPUTS))

    def plan(
        self,
        state: VehicleState,
        curvature_per_m: float,
        path: PathReference,
        previous: ControlInput,
        preview: CurvaturePreview | None = None,
        under_way: Sequence[ControlInput] = (),
    ) -> SolveStatus:
        motion = self._after(np.array(state)[TRACKED], under_way, curvature_per_m)
        delay = len(under_way)
        reference = self._reference.expand(path, state, curvature_per_m, preview, delay)[1:]
        self._pedals.update(state.vx_mps - path.v_mps, path.a_mps2)
        v_prev = np.array(previous) / self._bounds.scale
        limit_pedals(self._upper, self._periods, self._pedals, v_prev, self._bounds.slew)
        parameters = NmpcParameters(
            motion, v_prev, self._upper, reference[:, TRACKED], curvature_per_m
        )
        is_usable = self._solver.solve(parameters, self.inputs)
        return SolveStatus.SOLVED if is_usable else SolveStatus.NUMERICS

    def _after(
        self, motion: Array, inputs: Sequence[ControlInput], curvature_per_m: float
    ) -> Array:
        """The motion (5,) that is predicted after some inputs, one in each period."""
        for u in inputs:
            v = np.array(u) / self._bounds.scale
            motion = np.array(self._period(motion, v, curvature_per_m)).ravel()
        return motion

    def prepare(self) -> None:
        """Do nothing: the whole problem is solved in `plan`."""

    def warm_up(self) -> None:
        """Do nothing: a solve would move the iterate."""

    def observe(self, state: VehicleState, held: ControlInput) -> None:
        """Do nothing: the model has no history."""

    def forget(self) -> None:
        """Do nothing: the model has no history."""

    def reset(self) -> None:
        """Do nothing: no disturbance is estimated."""

    def resume(self, previous: ControlInput) -> None:
        self._pedals.resume(previous)

    def limit_solve_time(self, budget_ns: int) -> None:
        """Do nothing: the iterations are limited already."""


Controller = Mpc | Nmpc
DOMPC = "do-mpc, IPOPT"
NAMES = (DEFAULT, *(method.name for method in METHODS), DOMPC)
HEADS = {
    "times of a plan": {
        "plan_p50_us": Column("p50", "us"),
        "plan_p99_us": Column("p99", "us"),
        "plan_max_us": Column("max", "us"),
        "plan_p50_us_over_default": Column("p50", "/ default"),
        "both_p50_us_over_default": Column("with prepare", "/ default"),
    },
    "preparation and tracking errors": {
        "prepare_p50_us": Column("prepare", "p50 us"),
        "ey_rms_m": Column("e_y RMS", "m"),
        "ey_peak_m": Column("e_y peak", "m"),
        "vx_rms_mps": Column("v_x RMS", "m/s"),
    },
}


class ClosedLoopComparison:
    """All controllers for one model; compiling the nonlinear ones takes minutes."""

    def __init__(self, model: str, only: Sequence[str] = ()) -> None:
        self._bundle = load_bundle(shipped_model(model))
        self._controllers = {
            name: build()
            for name, build in _builders(self._bundle).items()
            if not only or name in (DEFAULT, *only)
        }

    def run(self, scenario: str, rounds: int) -> pd.DataFrame:
        """A row for each controller after driving the scenario in every round; columns as `HEADS`.

        Times of a plan are from the state to the inputs. The fastest plan is first.
        """
        names, rng = list(self._controllers), np.random.default_rng(0)
        rows = []
        for round_ in range(rounds):
            for index in rng.permutation(len(names)):
                controller = self._controllers[names[index]]
                figures = _drive(controller, self._bundle, scenario)
                rows.append({"round": round_, "name": names[index], **figures})
        ratios_of = ("plan_p50_us", "plan_p99_us", "both_p50_us")
        summary = summarise(pd.DataFrame(rows), ratios_of, {"default": DEFAULT})
        return summary.sort_values("plan_p50_us")


def _builders(bundle: Bundle) -> dict[str, Callable[[], Controller]]:
    settings = MpcSettings()
    horizon, cost = settings.horizon, settings.cost()

    def casadi(method: Method) -> Nmpc:
        return Nmpc(CasadiSolver(method, horizon, cost), horizon)

    def dompc() -> Nmpc:
        return Nmpc(DompcSolver(horizon, cost), horizon)

    return {
        DEFAULT: partial(build_mpc, bundle, settings),
        **{method.name: partial(casadi, method) for method in METHODS},
        DOMPC: dompc,
    }


def _drive(controller: Controller, bundle: Bundle, scenario: str) -> dict[str, float]:
    timed = _Timed(controller)
    # The loop calls nothing but what `_Timed` forwards.
    errors = drive_scenario(bundle, cast("Mpc", timed), scenario)
    plan = percentiles(timed.plan_us[WARM_UP_STEPS:], "plan_")
    prepare_p50_us = percentiles(timed.prepare_us)["p50_us"]
    return {
        **plan,
        "prepare_p50_us": prepare_p50_us,
        "both_p50_us": plan["plan_p50_us"] + prepare_p50_us,
        "ey_rms_m": errors.ey_rms_m,
        "ey_peak_m": errors.ey_peak_m,
        "vx_rms_mps": errors.vx_rms_mps,
    }


class _Timed:
    """A controller whose calls are timed."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.plan_us: list[float] = []
        self.prepare_us: list[float] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._controller, name)

    def plan(self, *arguments: Any) -> Any:
        status, took_us = timed(self._controller.plan, *arguments)
        self.plan_us.append(took_us)
        return status

    def prepare(self) -> None:
        self.prepare_us.append(timed(self._controller.prepare)[1])

    def warm_up(self) -> None:
        self.prepare_us[-1] += timed(self._controller.warm_up)[1]
