"""Why a vehicle brakes by itself, for the simulated car and for the gateway."""

from enum import Enum

from rt_controller.contract.timing import COMMAND_TIMEOUT_S


class BrakingCause(Enum):
    """The first cause of a braking of the vehicle; it lasts as long as the braking."""

    NO_COMMAND = f"no command that may be followed for {1e3 * COMMAND_TIMEOUT_S:g} ms"
    LEAVING_PATH = "the car was about to leave its path"
    ACTUATOR_FAILED = "an actuator does not follow its commands"
    """of the simulated car only: a gateway does not judge the actuators"""
    CAR_UNKNOWN = "the car does not say whether it follows the commands"
    """of the gateway only: `car_brakes` is missing, or has a value that is neither on nor off"""
    SECOND_SENDER = "another node sends the messages of this one, or two send one of the car"
    """of the gateway only"""
    END_REQUESTED = "the gateway was requested to end while it drove the car"
    """of the gateway only"""
