"""Bits that the two ends of the bus report: faults of the controller, refusals of the vehicle."""

from enum import IntFlag


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
