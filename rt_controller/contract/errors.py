"""The one error tree of the project, each leaf with its exit code.

Start-up raises these; inside the loop nothing raises: failures there are statuses.
A message says what was expected, what was found, and the remedy.
"""


class RtControllerError(Exception):
    """Base of every error that a person is meant to read; ends the program with `exit_code`."""

    exit_code = 1


class ConfigError(RtControllerError):
    """A setting, file or command line that does not make sense."""

    exit_code = 2


class ArtifactError(RtControllerError):
    """A model bundle that is missing, damaged, or made for another controller."""

    exit_code = 2


class DatasetError(RtControllerError):
    """A data set that is missing, damaged, or made by another recipe."""

    exit_code = 2


class MissingExtraError(RtControllerError):
    """A part of the program whose optional dependencies are not installed."""

    exit_code = 3


class BusError(RtControllerError):
    """A CAN bus that cannot be opened, or a peer that speaks another message catalogue."""

    exit_code = 5


class PlantError(RtControllerError):
    """A simulated car that stopped giving numbers in the middle of a run."""

    exit_code = 7
