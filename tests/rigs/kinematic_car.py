"""A car whose states fit together, and a supervisor that watches it; for tests of the checks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np

from rt_controller.contract.kinematics import heading_change_rad, lateral_change_m, progress_m
from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import (
    NEUTRAL_INPUT,
    ControlInput,
    CurvaturePreview,
    Mode,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.model.dynamics import Matrices
from rt_controller.model.validity import TrainedRange
from rt_controller.safety.checks import CHECKS, Check
from rt_controller.safety.motion import MotionPrediction
from rt_controller.safety.supervisor import Supervisor
from rt_controller.safety.tick import Estimate, Tick

STEER_TO_YAW = 0.3
"""yaw rate of the linear model per radian at the wheel, within one period"""
BRAKE_TO_SPEED = -0.05 * PERIOD_S
STRAIGHT = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)
TURNING_RAD = 0.2
"""of the wheel: a yaw rate of 0.06 rad/s"""
WITHOUT_FROZEN = [check for check in CHECKS if check.quantity is not Quantity.FROZEN_TICKS]
"""a scripted car has no noise, so each constant offset also looks like a frozen state"""


def linear_model() -> Matrices:
    """The speed keeps its value but for the brake, the yaw rate is proportional to the wheel."""
    A = np.diag([1.0, 1.0, 0.0, 1.0, 1.0, 1.0])
    B_uc = np.zeros((6, 3))
    B_uc[2, 2], B_uc[0, 1] = STEER_TO_YAW, BRAKE_TO_SPEED
    return Matrices(A, B_uc, np.zeros((6, 1)), np.zeros(6))


@dataclass
class WatchedCar:
    """The car follows `control` exactly; `disturb` changes what the supervisor receives."""

    checks: Sequence[Check] = CHECKS
    vx_mps: float = 20.0
    ey_m: float = 0.0
    epsi_rad: float = 0.0
    curvature_per_m: float = 0.0
    control: ControlInput = NEUTRAL_INPUT
    path: PathReference | None = STRAIGHT
    preview: CurvaturePreview | None = None
    disturb: Callable[[Tick], Tick] = lambda received: received
    has_model: bool = True
    is_stopping: bool = False
    trained: TrainedRange | None = None
    qualified: list[Estimate] = field(default_factory=list)

    def __post_init__(self) -> None:
        prediction = MotionPrediction(linear_model(), 6) if self.has_model else None
        self.supervisor = Supervisor(prediction, checks=self.checks, trained=self.trained)
        self.state = VehicleState(
            self.vx_mps, 0.0, 0.0, self.vx_mps * PERIOD_S, self.ey_m, self.epsi_rad
        )
        self.is_driven = False
        self.feedback: ControlInput | None = None

    def tick(self, times: int = 1) -> Estimate:
        """The qualified of the last of so many periods."""
        for _ in range(times):
            if self.is_driven:
                self._move()
            driving = Mode.SAFE_STOP if self.is_stopping else Mode.NOMINAL
            received = Tick(
                last_mode=driving if self.is_driven else Mode.STANDBY,
                state=self.state,
                curvature_per_m=self.curvature_per_m,
                path=None if self.path is None else PathReference(*self.path),
                preview=None if self.preview is None else CurvaturePreview(*self.preview),
                applied=self.control,
                feedback=self.feedback,
            )
            qualified = self.supervisor.check(self.disturb(received))
            psi = None if qualified.state is None else np.array(qualified.state)
            self.supervisor.note(self.control, psi)
            self.is_driven = True
            self.qualified.append(qualified)
        return self.qualified[-1]

    def _move(self) -> None:
        before = self.state
        vx_mps = max(before.vx_mps + BRAKE_TO_SPEED * self.control.brake_n, 0.0)
        now = before._replace(vx_mps=vx_mps, yaw_rate_radps=STEER_TO_YAW * self.control.steer_rad)
        now = now._replace(ds_m=progress_m(before, now, self.curvature_per_m))
        turned = heading_change_rad(before, now, self.curvature_per_m, now.ds_m)
        now = now._replace(epsi_rad=before.epsi_rad + turned)
        self.state = now._replace(ey_m=before.ey_m + lateral_change_m(before, now))


def driven(ticks: int, *checks: Sequence[Check], **arguments: object) -> WatchedCar:
    """A car that was driven for so many periods."""
    car = WatchedCar(*checks, **arguments)  # type: ignore[arg-type]
    car.tick(ticks)
    return car


def turning(**arguments: object) -> WatchedCar:
    """A car that turns with its road."""
    car = WatchedCar(curvature_per_m=0.003, **arguments)  # type: ignore[arg-type]
    car.control = car.control._replace(steer_rad=TURNING_RAD)
    car.path = STRAIGHT
    return car


def replaced(**signals: float) -> Callable[[Tick], Tick]:
    """These signals of the state have these values."""
    return lambda received: replace(
        received, state=None if received.state is None else received.state._replace(**signals)
    )


def shifted(**signals: float) -> Callable[[Tick], Tick]:
    """These signals of the state have these offsets."""

    def change(received: Tick) -> Tick:
        assert received.state is not None
        moved = {name: getattr(received.state, name) + value for name, value in signals.items()}
        return replace(received, state=received.state._replace(**moved))

    return change


def growing(signal: str, per_tick: float) -> Callable[[Tick], Tick]:
    """The offset of this signal grows from tick to tick."""
    ticks = count(1)

    def change(received: Tick) -> Tick:
        return shifted(**{signal: per_tick * next(ticks)})(received)

    return change


def undisturbed(received: Tick) -> Tick:
    """All arrives as it is."""
    return received


def nothing(received: Tick) -> Tick:
    """Neither state nor path arrives."""
    return replace(received, state=None, path=None, preview=None)


def only(*quantities: Quantity) -> list[Check]:
    """The checks of these quantities."""
    by_quantity = {check.quantity: check for check in CHECKS}
    return [by_quantity[quantity] for quantity in quantities]
