"""The controller as a function of state and path: no bus, no loop, no safety modes."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from numbers import Real
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from threadpoolctl import ThreadpoolController

from rt_controller.bus.messages import REFERENCE, STATE, Message
from rt_controller.config import ControllerConfig, require_config
from rt_controller.contract.arrays import Array
from rt_controller.contract.car import UNNAMED_CAR
from rt_controller.contract.preview import require_curvature, require_range
from rt_controller.contract.signals import (
    NEUTRAL_INPUT,
    ControlInput,
    CurvaturePreview,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.program import SolveStatus
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_mpc

Vector = TypeVar("Vector", VehicleState, PathReference, CurvaturePreview, ControlInput)


@dataclass(frozen=True, slots=True)
class Plan:
    """Inputs over the horizon and the states that the model predicts under them."""

    status: SolveStatus
    """SOLVED, or why there is no plan; then all numbers are NaN"""
    inputs: Array
    """(N, 3), columns as `ControlInput`: held over one period each"""
    states: Array
    """(N + 1, 6), columns as `VehicleState`: the predicted trajectory, the measured state first"""
    iterations: int
    """of the QP solver"""
    solve_time_s: float

    @property
    def is_solved(self) -> bool:
        """True if the plan may be driven."""
        return self.status is SolveStatus.SOLVED

    @property
    def control(self) -> ControlInput:
        """The first input: the one to apply now. NaN where the plan is not solved."""
        return ControlInput(*self.inputs[0].tolist())

    @property
    def time_s(self) -> Array:
        """(N + 1,) time of each predicted state, from now."""
        return np.arange(len(self.states), dtype=np.float64) * PERIOD_S


class Controller:
    """Model predictive control with a learned model, one call a period.

        controller = Controller.load("mdk-net")
        plan = controller.step(state, path, curvature_per_m=0.0)
        apply(plan.control)

    It plans and nothing else. Frames, time-outs, the safe stop and the limits of what is sent are
    those of the program `rt-controller`; a caller that drives a vehicle needs its own. So does one
    that starts and stops: at low speed `rt-controller` drives by another law, which holds the car.

    Paper: eqs. (7) and (14).
    """

    def __init__(
        self, model: str | Path | Bundle | None = None, config: ControllerConfig | None = None
    ) -> None:
        """Load the model, assemble its QP and solve it once.

        Args:
            model: name of a shipped model, folder of a bundle, or a `Bundle`; default: that of
                `config`, mdk-net.
            config: settings; of them `mpc` and `model` are used. Default: those of `rt-controller`.

        Raises:
            ArtifactError: there is no such model, it is damaged, or it is of another vehicle.
            ConfigError: the settings give no QP that can be solved.
            TypeError: model or settings are of another type.
        """
        config = require_config(config)
        self.bundle = Bundle.load(config.model if model is None else model)
        """the model"""
        self._mpc = build_mpc(self.bundle, config.mpc)
        self._car = self.bundle.car or UNNAMED_CAR
        # The products are small: threads of the linear algebra make them slower, and on a busy
        # machine a hundred times slower. The programs set this before numpy is imported.
        self._threads = ThreadpoolController()
        self.reset()

    @classmethod
    def load(
        cls, model: str | Path | Bundle | None = None, config: ControllerConfig | None = None
    ) -> "Controller":
        """The same as `Controller(model, config)`."""
        return cls(model, config)

    def reset(self, previous: ControlInput = NEUTRAL_INPUT) -> None:
        """Forget the past; `previous` is the input that is applied at present.

        Raises:
            TypeError, ValueError: `previous` is not three finite numbers.
        """
        previous = _input("previous", previous)
        self._mpc.reset()
        self._previous = previous

    def step(
        self,
        state: VehicleState,
        path: PathReference,
        curvature_per_m: float | CurvaturePreview,
        applied: ControlInput | None = None,
        under_way: Sequence[ControlInput] = (),
    ) -> Plan:
        """The plan from `state`, one period after the last call.

        Call `reset` where a period is missing: the history that some encoders receive, and the
        slew rates, assume one call a period. Check `is_solved` before you apply `control`: an
        infeasible problem gives a plan of NaN, and the history starts again. A measurement that is
        NaN is refused: the caller decides how to drive without it, and calls `reset` afterwards.

        Args:
            state: measured now, SI units.
            path: as `PathReference`, seen from the car.
            curvature_per_m: of the road's reference line: a number, which is taken as constant, or
                a preview of the road ahead.
            applied: input that acted in the last period; default: `control` of the last plan.
            under_way: inputs of earlier plans that have not acted yet, the oldest first, where the
                car follows with a delay: the plan begins after them.

        Raises:
            TypeError: something else, or of another length; arrays and lists are taken too.
            ValueError: `applied` is not finite, or state, path or curvature is NaN or beyond the
                range of its signal on the bus (`contract/messages.dbc`).
        """
        # All is checked before anything is stored.
        state = _vector("state", state, VehicleState)
        path = _vector("path", path, PathReference)
        _require_in_range("state", state, STATE)
        _require_in_range("path", path, REFERENCE)
        here_per_m, preview = _curvature(curvature_per_m)
        if applied is not None:
            self._previous = _input("applied", applied)
        with self._threads.limit(limits=1, user_api="blas"):
            return self._plan(state, path, here_per_m, preview, under_way)

    def _plan(
        self,
        state: VehicleState,
        path: PathReference,
        curvature_per_m: float,
        preview: CurvaturePreview | None,
        under_way: Sequence[ControlInput],
    ) -> Plan:
        x_0 = self._mpc.observer.observe(state, self._previous)
        most_rad = self._car.largest_plan_rad(x_0.vx_mps, self.bundle.largest_steer_rad)
        # A wheel that is turned further returns with its rate.
        self._mpc.limit_steering(max(most_rad, abs(self._previous.steer_rad)), inf)
        status = self._mpc.plan(x_0, curvature_per_m, path, self._previous, preview, under_way)
        states = self._mpc.predicted_states()
        inputs = self._mpc.inputs.copy()
        if states is None:
            self._mpc.forget()  # what gave no plan must not stay in the history
            inputs[:] = np.nan
            states = np.full((len(inputs) + 1, len(VehicleState._fields)), np.nan)
        else:
            self._previous = ControlInput(*inputs[0].tolist())
        plan = Plan(status, inputs, states, self._mpc.iterations, self._mpc.solve_ns * 1e-9)
        self._mpc.prepare()
        return plan


def _vector(name: str, found: Any, kind: type[Vector]) -> Vector:
    numbers = np.asarray(found, dtype=object)
    is_another_kind = isinstance(found, tuple) and type(found) not in (tuple, kind)
    is_numeric = all(isinstance(number, Real) for number in numbers.flat)
    if is_another_kind or numbers.shape != (len(kind._fields),) or not is_numeric:
        raise TypeError(
            f"{name}: expected {len(kind._fields)} numbers ({', '.join(kind._fields)}), found "
            f"{found!r:.80}."
        )
    return kind(*map(float, numbers))


def _require_in_range(name: str, found: Vector, message: Message[Any]) -> None:
    """Return if all fields are within the ranges that they have on the bus; NaN is not."""
    for field, value, (low, high) in zip(found._fields, found, message.ranges, strict=False):
        if not low <= value <= high:
            raise ValueError(
                f"{name}.{field}: expected {low:g} to {high:g}, found {value:g}. The name ends in "
                f"the unit."
            )


def _curvature(found: Any) -> tuple[float, CurvaturePreview | None]:
    """The curvature at the car in 1/m, and the preview if there is one."""
    if isinstance(found, np.ndarray) and found.ndim == 0:
        found = found.item()
    if isinstance(found, Real):
        require_curvature("curvature_per_m", float(found))
        return float(found), None
    try:
        preview = _vector("curvature_per_m", found, CurvaturePreview)
    except TypeError:
        raise TypeError(
            f"curvature_per_m: expected one number, or a CurvaturePreview "
            f"({', '.join(CurvaturePreview._fields)}), found {found!r:.60}."
        ) from None
    require_range("curvature_per_m", preview.spacing_m, preview[1:])
    return preview.k0_per_m, preview


def _input(name: str, found: Any) -> ControlInput:
    control = _vector(name, found, ControlInput)
    if not np.isfinite(control).all():
        raise ValueError(f"{name}: expected finite numbers, found {control}.")
    return control
