"""The MPC of this project with the fitted bicycle in place of a learned model.

Course cost, horizon, knots, input limits, pedals, compensation of the delay, estimator and QP are
those of `Mpc`. It linearises along the last plan and solves one QP a period (linear time-varying
MPC).
"""

from collections.abc import Mapping
from math import inf
from typing import Any

import numpy as np

from rt_controller.baselines.bicycle import Bicycle
from rt_controller.baselines.tuned import tuned_values
from rt_controller.config import MpcSettings, Tolerances
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import N_INPUTS, N_STATES, ControlInput
from rt_controller.contract.timing import HOLD_PLAN_TICKS
from rt_controller.control.law import Observation
from rt_controller.control.mpc import Mpc
from rt_controller.control.program import SolveStatus


def settings_of(values: Mapping[str, float]) -> MpcSettings:
    """Settings with these tolerances and other fields by their names."""
    tolerances = {k: v for k, v in values.items() if k in Tolerances.model_fields}
    others: dict[str, Any] = {k: v for k, v in values.items() if k not in tolerances}
    return MpcSettings(tolerance=Tolerances(**tolerances), **others)


class BicycleLinearisation:
    """The attributes and the method of `Linearisation`, of the bicycle."""

    is_linear = False

    def __init__(self, bicycle: Bicycle, horizon: int) -> None:
        self._bicycle = bicycle
        self.psi = np.zeros((horizon + 1, N_STATES))
        self.J = np.zeros((horizon, N_STATES, N_STATES + N_INPUTS + 1))

    def update(self, psi_0: Array, u: Array, kappa: float) -> None:
        """As `Linearisation.update`."""
        self.psi[:] = self._bicycle.predict(psi_0.tolist(), u, kappa)
        self.J = self._bicycle.derivatives(self.psi[:-1], u, kappa)


class _TimeVaryingMpc(Mpc):
    """Linear time-varying MPC with the bicycle."""

    def __init__(self, settings: MpcSettings) -> None:
        bicycle = Bicycle()
        super().__init__(
            bicycle.bundle(),
            settings.horizon,
            settings.cost(),
            disturbance_gain=settings.disturbance_gain,
            step=bicycle.step,
        )
        # The product has one linearisation only, so its type provides for no other one.
        of_bicycle: Any = BicycleLinearisation(bicycle, settings.horizon)
        self._qp.linearisation = of_bicycle


class BicycleMpc:
    """The law; a `ControlLaw`."""

    def __init__(self, values: Mapping[str, float] | None = None) -> None:
        """`values`: weights by their names; default those that the search found."""
        settings = settings_of(tuned_values("bicycle-mpc") if values is None else values)
        self._mpc = _TimeVaryingMpc(settings)
        self._is_first = True
        self._periods_held = HOLD_PLAN_TICKS + 1

    def reset(self) -> None:
        """The next observation does not follow on the last one."""
        self._mpc.reset()
        self._is_first = True
        self._periods_held = HOLD_PLAN_TICKS + 1

    def control(self, now: Observation) -> ControlInput:
        """The first input of the plan, or the next one of the last plan.

        Raises:
            ArithmeticError: the QP was not solved for more than two periods.
        """
        mpc = self._mpc
        if self._is_first:
            mpc.resume(now.previous)
        self._is_first = False
        mpc.limit_steering(now.most_steer_rad, inf)
        x_0 = mpc.observer.observe(now.state, now.previous)
        status = mpc.plan(
            x_0, now.curvature_per_m, now.path, now.previous, now.preview, now.under_way
        )
        self._periods_held = 0 if status is SolveStatus.SOLVED else self._periods_held + 1
        if self._periods_held > HOLD_PLAN_TICKS:
            raise ArithmeticError(f"the QP of bicycle-mpc was not solved: {status.name}")
        control = ControlInput(*mpc.inputs[self._periods_held].tolist())
        mpc.prepare()
        return control
