"""The contents of the messages, as the program uses them: SI units, times in nanoseconds."""

from enum import IntFlag
from typing import NamedTuple

from rt_controller.contract.signals import ControlInput, Mode, VehicleState


class Fault(IntFlag):
    """The fault bits of CTRL_HB."""

    STATE_STALE = 1
    STATE_INVALID = 2
    SOLVER_FAILED = 4
    DEADLINE_MISSED = 8
    MISSION_MISSING = 16
    BUS_FAULT = 32
    PEER_MISMATCH = 64
    PREVIEW_IMPLAUSIBLE = 128
    COMMANDS_UNANSWERED = 256
    SOURCE_CONFLICT = 512
    STATE_IMPLAUSIBLE = 1024
    PATH_IMPLAUSIBLE = 2048
    ACTUATOR_MISMATCH = 4096
    NOT_ENGAGED = 8192


NO_FAULT = Fault(0)


class Refusal(IntFlag):
    """The bits of VehicleFaults in STATE_C: why the vehicle refuses a command."""

    BRAKING = 1
    """it brakes by itself"""
    LATE = 2
    """no command, or one that answers an old state"""
    HEARTBEAT = 4
    """no heartbeat with the counter and the mode of the command"""
    MODE = 8
    """the input contradicts the mode"""
    PEDALS = 16
    """both pedals"""
    STEERING = 32
    """an input that is not finite or out of bounds, or the wheel moves too fast"""
    LATERAL_ACCELERATION = 64
    """more steering than the speed allows"""
    SOURCE = 128
    """commands of another controller, or of another message catalogue"""


NO_REFUSAL = Refusal(0)


class Command(NamedTuple):
    """Content of ACT_CMD."""

    control: ControlInput
    mode: Mode


class StateSample(NamedTuple):
    """Content of STATE_A, STATE_B and STATE_C: the car at one instant."""

    state: VehicleState
    curvature_per_m: float
    sample_time_ns: int
    """on the vehicle's clock; from the bus: modulo `SAMPLE_TIME_WRAP_NS`, to 0.1 ms"""
    command_echo: int | None
    """state counter of the newest accepted command, None before the first"""
    is_watchdog_braking: bool
    """the vehicle brakes by itself"""
    refusals: Refusal = NO_REFUSAL
    """why it refused the newest command; without `Refusal.BRAKING`"""


class Mission(NamedTuple):
    """Content of MISSION: the request to the controller."""

    is_engaged: bool
    is_reset_requested: bool
    """explicit request to leave SAFE_STOP"""
    mission_id: int
    """0..254"""
    valid_for_ns: int
    """counted from the arrival; at most 60 s, to the millisecond"""


class Heartbeat(NamedTuple):
    """Content of CTRL_HB: state of the controller."""

    mode: Mode
    faults: Fault
    state_counter: int
    """long counter of the state that the command answers, 0..127"""
    compute_time_ns: int | None
    state_age_ns: int | None
    """None: no state yet, or older than the signal can express"""
    qp_iterations: int | None
    """None: no QP was solved"""


class Identity(NamedTuple):
    """Content of IDENT_CONTROLLER and IDENT_VEHICLE."""

    dbc_hash: int
    model_hash: int | None
