"""What is wrong: bits that the two ends of the bus report, and the causes of a stop."""

from enum import IntFlag, StrEnum


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
    SPEED_NOT_FOLLOWED = 16384
    OUTSIDE_TRAINING = 32768


NO_FAULT = Fault(0)
FAULT_SENTENCES = {
    Fault.STATE_STALE: "No new vehicle state arrived in time; for two ticks at most the last plan "
    "is followed, then the car is stopped.",
    Fault.STATE_INVALID: "The vehicle state had values that may not be used.",
    Fault.SOLVER_FAILED: "No input was planned: the QP was not solved, or the control law failed.",
    Fault.DEADLINE_MISSED: "The commands were sent after their deadline.",
    Fault.MISSION_MISSING: "There was no valid mission.",
    Fault.BUS_FAULT: "The bus could not be read, or was off.",
    Fault.PEER_MISMATCH: "The vehicle used another message catalogue.",
    Fault.PREVIEW_IMPLAUSIBLE: "The curvature ahead contradicted the state or the one before, and "
    "was not used.",
    Fault.COMMANDS_UNANSWERED: "The vehicle did not accept the commands in time.",
    Fault.SOURCE_CONFLICT: "A second participant sent states or commands.",
    Fault.STATE_IMPLAUSIBLE: "Values of the vehicle state contradicted each other or the model; an "
    "estimate replaced them.",
    Fault.PATH_IMPLAUSIBLE: "The path jumped, was too sharp, or led away from the car.",
    Fault.ACTUATOR_MISMATCH: "An actuator followed the commands too late, or not at all.",
    Fault.NOT_ENGAGED: "The car was outside of the window in which the controller may begin to "
    "drive.",
    Fault.SPEED_NOT_FOLLOWED: "The speed was far from the wanted one for seconds.",
    Fault.OUTSIDE_TRAINING: "The motion was outside of what the model was trained with.",
}
"""what each bit says of a drive"""


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
_STATE, _PATH = Fault.STATE_IMPLAUSIBLE, Fault.PATH_IMPLAUSIBLE
_ACTUATOR = Fault.ACTUATOR_MISMATCH
_OF_VALUES = "Check what sends or measures these values."
_COUNTED = "(sim-bridge) runs and its frames arrive; the summary counts dropped and missing ones."


class StopCause(StrEnum):
    """Why the plan is held, or the car is stopped: its words, the bit that says so, a remedy."""

    fault: Fault
    """bit of the heartbeat; NO_FAULT: another bit says it, or none does"""
    remedy: str
    """what to do, as a sentence; empty where the cause says it"""

    def __new__(cls, text: str, fault: Fault = NO_FAULT, advice: str = "") -> "StopCause":
        cause = str.__new__(cls, text)
        cause._value_, cause.fault = text, fault
        cause.remedy = advice if fault is NO_FAULT else _OF_VALUES
        return cause

    @property
    def is_of_checks(self) -> bool:
        """True if a check of plausibility finds it."""
        return self.fault is not NO_FAULT

    NONE = "none"
    STATE_LOST = (
        "no new vehicle state arrived in time",
        NO_FAULT,
        f"Check that the vehicle {_COUNTED}",
    )
    STATE_CONFLICT = (
        "states of a second vehicle, or old ones, arrive among those of the vehicle",
        NO_FAULT,
        "Stop the second vehicle, or the program that replays a log.",
    )
    COMMANDS_UNANSWERED = (
        "the vehicle does not accept the commands in time",
        NO_FAULT,
        "Check that commands arrive at the vehicle, and why it refuses them (refused_ticks in its "
        "summary).",
    )
    STATE_INVALID = "the vehicle state arrives with values that may not be used"
    REFERENCE_LOST = (
        "no fresh path reference",
        NO_FAULT,
        f"Check that the path planner {_COUNTED}",
    )
    REFERENCE_INVALID = "the path reference arrives with values that may not be used"
    MISSION_LOST = (
        "the mission is no longer valid",
        NO_FAULT,
        f"Check that the vehicle {_COUNTED}",
    )
    SOLVER_FAILED = (
        "no input was planned: the QP was not solved, or the control law failed",
        NO_FAULT,
        "Check the tolerances of --mpc and the model, or the control law of --controller.",
    )
    BUS_FAILED = "the bus cannot be read"
    BUS_OFF = (
        "no new vehicle state arrives: the CAN controller is bus-off",
        NO_FAULT,
        "Check wiring, termination and bit rate; the driver restarts the controller with "
        "restart-ms.",
    )
    INTERFACE_DOWN = (
        "no new vehicle state arrives: the CAN interface is down",
        NO_FAULT,
        "Bring the interface up (ip link set CHANNEL up).",
    )
    SECOND_CONTROLLER = (
        "another controller sends commands on this bus",
        NO_FAULT,
        "Stop the other one, or choose another channel.",
    )
    PEER_MISMATCH = (
        "the vehicle uses another message catalogue",
        NO_FAULT,
        "Start the same version at both ends.",
    )
    VEHICLE_BRAKING = "the vehicle's own watchdog is braking"
    STOP_REQUESTED = "stop requested"
    SPEED_IMPLAUSIBLE = "v_x contradicts the progress along the road, or the model", _STATE
    PROGRESS_IMPLAUSIBLE = "the progress along the road contradicts v_x", _STATE
    LATERAL_SPEED_IMPLAUSIBLE = (
        "v_y contradicts the change of the lateral error, or the model",
        _STATE,
    )
    YAW_RATE_IMPLAUSIBLE = (
        "the yaw rate contradicts the change of the heading, or the model",
        _STATE,
    )
    HEADING_IMPLAUSIBLE = "the heading error contradicts the yaw rate and the curvature", _STATE
    LATERAL_ERROR_IMPLAUSIBLE = "the lateral error contradicts speed and heading", _STATE
    CURVATURE_IMPLAUSIBLE = "the curvature contradicts yaw rate and heading", _STATE
    STATE_FROZEN = "the vehicle state does not change while the car moves", _STATE
    STATE_OLD = "old values of the vehicle state arrive in new frames", _STATE
    STEERING_MISMATCH = "the steering wheel does not follow the commands", _ACTUATOR
    THROTTLE_MISMATCH = "the accelerator does not follow the commands", _ACTUATOR
    BRAKE_MISMATCH = "the brake does not follow the commands", _ACTUATOR
    TRACKING_LOST = "the car is too far from its path", _STATE
    PATH_JUMP = "the path jumps", _PATH
    PATH_INCONSISTENT = "the path does not continue the path that was sent before", _PATH
    PATH_SPEED_JUMP = "the wanted speed jumps", _PATH
    PREVIEW_JUMP = "the curvature ahead does not continue the one that was sent before", _PATH
    PATH_TOO_SHARP = "the path needs more lateral acceleration than is allowed", _PATH
    NOT_ENGAGED = (
        "the car is outside of the window in which the controller may begin to drive",
        Fault.NOT_ENGAGED,
    )
    SPEED_NOT_FOLLOWED = (
        "the speed is far from the wanted one for seconds",
        Fault.SPEED_NOT_FOLLOWED,
    )
    OUTSIDE_TRAINING = (
        "the motion is outside of what the model was trained with",
        Fault.OUTSIDE_TRAINING,
    )
    """the last two are only reported: nothing stops for them"""
