"""What a control step says about itself, to the loop and to people."""

from dataclasses import dataclass
from enum import StrEnum

from rt_controller.bus.snapshot import StateSnapshot
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode, PathReference


class StopCause(StrEnum):
    """What took the plan away."""

    NONE = "none"
    STATE_LOST = "no new valid vehicle state"
    REFERENCE_LOST = "no fresh path reference"
    MISSION_LOST = "the mission's validity ran out"
    SOLVER_FAILED = "the QP was not solved"
    BUS_FAILED = "the bus cannot be read"
    SECOND_CONTROLLER = "another controller sends commands on this bus"
    PEER_MISMATCH = "the vehicle speaks another message catalogue"
    VEHICLE_BRAKING = "the vehicle's own watchdog is braking"
    STOP_REQUESTED = "asked to stop"


@dataclass(slots=True)
class StepOutcome:
    """What one step saw and did; one instance, overwritten every tick."""

    mode: Mode = Mode.STANDBY
    control: ControlInput = NEUTRAL_INPUT
    state: StateSnapshot | None = None
    """None: nothing new, valid and timely this tick"""
    path: PathReference | None = None
    listen_ns: int = 0
    """reading frames before the tick, while it waited for nothing"""
    hear_ns: int = 0
    """reading what came since, and judging it all"""
    plan_ns: int = 0
    """lifting, building and solving; next to nothing where nothing was planned"""
    qp_ns: int = 0
    """0: nothing was solved this tick"""
    answer_ns: int = 0
    """judging the plan and handing frames to the bus"""
    cpu_ns: int = 0
    """what this thread computed from hearing to answering, whatever else ran meanwhile"""
    qp_iterations: int = 0
    cause: StopCause = StopCause.NONE
    """why the plan is held, or the car stopped"""
