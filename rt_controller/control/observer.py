"""The filtered state x_0 of eq. (14) and its lift psi_0, from what is measured each period."""

from collections.abc import Sequence

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import AT_REST, ControlInput, VehicleState
from rt_controller.control.estimator import Estimator
from rt_controller.control.lift import Encoder, History
from rt_controller.model.bundle import Bundle
from rt_controller.model.roll_outs import OneStep


class StateObserver:
    """Encoder, history and estimator of one bundle. Inputs are those of the car.

    A period is `x_0 = observe(...)`, `psi_0 = lift(x_0, ...)`, and `advance(...)` when it is known
    which input acts in it.
    """

    def __init__(
        self, bundle: Bundle, periods: int, motion_gain: float, step: OneStep | None = None
    ) -> None:
        """The arguments are those of `Estimator`."""
        self.encoder = Encoder(bundle)
        rows = self.encoder.history
        self.psi = self.encoder.psi
        """(n,), the state that was lifted last; overwritten by the next"""
        self._history = None if rows is None else History(rows)
        self.estimator = Estimator(bundle, periods, motion_gain, step)
        self.steering = self.estimator.steering
        self._curvature_per_m = 0.0
        """of the road in the period before"""
        self.measured = AT_REST
        """the last state as it was observed, without the filter"""

    def observe(self, state: VehicleState, held: ControlInput) -> VehicleState:
        """x_0: the filtered `state`, added to the history; `held` was applied until now."""
        self.measured = state
        x_0 = self.estimator.estimate(state, self._curvature_per_m)
        if self._history is not None:
            self._history.advance(x_0, self.steering.of_model(held))
        return x_0

    def observe_estimate(self, state: VehicleState, held: ControlInput) -> VehicleState:
        """The same with a state that is partly estimated, since a signal is faulty.

        What was learned from the faulty signal is discarded, and nothing is learned from it.
        """
        self.estimator.reset()
        return self.observe(state, held)

    def lift(self, x_0: VehicleState, curvature_per_m: float) -> Array:
        """psi_0 (n,) of this period's state, on a road of this curvature."""
        self._curvature_per_m = curvature_per_m
        return self.encoder.lift(x_0, curvature_per_m)

    def after(self, psi: Array, under_way: Sequence[ControlInput]) -> Array:
        """The lifted state (n,) after the inputs that act before the next one can."""
        for each in under_way:
            of_model = self.steering.of_model(each)
            psi = self.estimator.step(psi, of_model, self._curvature_per_m)
        return psi

    def advance(self, acting: ControlInput) -> None:
        """Predict the next state from `psi`, with the input that acts in this period."""
        self.estimator.advance(self.psi, acting, self._curvature_per_m)

    def assume_steady(
        self, state: VehicleState, curvature_per_m: float, applied: ControlInput
    ) -> None:
        """A drive begins with a car, `state` observed last, that turns steadily with this input."""
        psi = self.encoder.lift(state, curvature_per_m)
        self.estimator.assume_steady(psi, applied, curvature_per_m)

    def forget(self) -> None:
        """Discard the history: a period or more is missing before the next state."""
        self.estimator.forget()
        if self._history is not None:
            self._history.forget()

    def reset(self) -> None:
        """Another drive begins: discard all that was learned from the last one."""
        self.forget()
        self.estimator.reset()
