"""One tick: what is received, what of it is accepted, what is planned, and what is sent."""

from dataclasses import dataclass, field
from typing import NamedTuple

from rt_controller.contract.faults import NO_FAULT, Fault, StopCause
from rt_controller.contract.limits import INPUT_LIMITS, InputLimits
from rt_controller.contract.signals import (
    NEUTRAL_INPUT,
    ControlInput,
    CurvaturePreview,
    Mode,
    PathReference,
    VehicleState,
)
from rt_controller.model.validity import Excess
from rt_controller.safety.freshness import ON_TIME, SampleTime


class Estimate(NamedTuple):
    """What is planned from: final, no later stage chooses another state, path or curvature."""

    state: VehicleState | None = None
    """measured where it is accepted, otherwise estimated; None: none has arrived yet"""
    curvature_per_m: float = 0.0
    path: PathReference | None = None
    """received or, if it was not, the last one that was accepted"""
    preview: CurvaturePreview | None = None
    is_measured: bool = False
    """the whole state arrived in this tick and was accepted"""
    is_path_received: bool = False
    """the path arrived in time and was accepted"""
    speed_mps: float | None = None
    """as far as it is measured and accepted: v_x, or from the progress"""
    alarm: StopCause = StopCause.NONE
    """what stops the car"""
    rejection: StopCause = StopCause.NONE
    """why state or path of this tick are not used, or why the drive does not begin"""
    stops: bool = False
    """the car is to be brought to rest, whatever speed the path says"""
    report: Fault = NO_FAULT
    """bits of the heartbeat for which nothing stops"""
    excess: Excess | None = None
    """what is furthest outside of the training of the model, where that is reported"""


NO_ESTIMATE = Estimate()


@dataclass(slots=True)
class Tick:
    """One tick, filled in by its stages: receive, check, plan, decide.

    A new one begins with nothing received: no value of an earlier tick can be taken for a new one.
    """

    periods: int = 1
    """since the last tick"""
    last_mode: Mode = Mode.STANDBY
    """STANDBY: nothing is compared, and the checks restart at the state that arrives"""

    # received; None: nothing that is fresh and valid
    state: VehicleState | None = None
    """new in this tick, and in time"""
    curvature_per_m: float = 0.0
    """of the state"""
    sample_time: SampleTime = ON_TIME
    """of the state"""
    is_next_state: bool = False
    """no period lies between the last state and this one"""
    is_vehicle_braking: bool = False
    """the watchdog of the vehicle has the car"""
    path: PathReference | None = None
    preview: CurvaturePreview | None = None
    """as it arrived, also if it contradicts the curvature"""
    has_implausible_preview: bool = False
    """it contradicts the curvature, and is not planned with"""
    feedback: ControlInput | None = None
    """of the actuators, new in this tick, while they follow this controller"""
    applied: ControlInput | None = None
    """the command that acted in the last period; None: not known, or not one of this controller"""
    late_ticks: int = 0
    """by which the steering wheel is known to be later than it is configured"""
    has_mission: bool = False
    is_engaged: bool = False
    is_reset_requested: bool = False
    """by a mission message that is new in this tick"""
    is_ending: bool = False
    """the newest mission no longer engages, and is not confirmed yet: a driver may have the car"""
    is_answered: bool = True
    """the vehicle accepts the commands: the state echoes one that is recent enough"""
    has_conflict: bool = False
    """frames of the state contradict each other: of two vehicles, or old ones among new ones"""
    has_invalid_state: bool = False
    """frames of the state with values that may not be used were received"""
    has_invalid_path: bool = False
    """frames of the path with values that may not be used were received"""
    bus_fault: StopCause = StopCause.NONE
    """one of `BUS_CAUSES`, also in a safe stop that began for another reason"""
    state_loss: StopCause = StopCause.STATE_LOST
    """STATE_LOST or one of `RECOVERABLE_BUS_CAUSES`: the cause if no state arrives"""
    is_wheel_matched: bool = True
    """the commands of STANDBY have reached the angle of the steering wheel"""
    is_stop_requested: bool = False

    estimate: Estimate = NO_ESTIMATE
    """what the checks accept"""

    # planned
    planned: ControlInput | None = None
    """the last good plan's input for this tick; None: it has none left"""
    periods_held: int = 0
    """periods since the plan was made; 0: in this tick"""
    law: Mode = Mode.STANDBY
    """what made the plan: NOMINAL the model, LOW_SPEED or STANDSTILL the low-speed law"""
    has_solver_failed: bool = False
    qp_iterations: int = 0
    qp_ns: int = 0
    """time of the solve; 0: no QP was solved"""

    # decided and sent
    mode: Mode = Mode.STANDBY
    cause: StopCause = StopCause.NONE
    """why the plan is held, or the car is stopped"""
    control: ControlInput = NEUTRAL_INPUT
    faults: Fault = NO_FAULT
    """as in the heartbeat"""
    limits: InputLimits = INPUT_LIMITS
    """of the car, in this tick: the bound of the steering wheel depends on the speed"""

    is_driven: bool = field(init=False)
    """this program has driven the car until now"""
    is_stopping: bool = field(init=False)
    """a safe stop has begun before this tick"""

    def __post_init__(self) -> None:
        self.is_driven = self.last_mode is not Mode.STANDBY
        self.is_stopping = self.last_mode is Mode.SAFE_STOP
