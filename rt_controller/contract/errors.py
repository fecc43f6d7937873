"""The one error tree of the project, each leaf with its exit code.

Start-up raises these; inside the loop nothing raises: failures there are statuses.
A message states what was expected, what was found, and the remedy.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from types import UnionType


class RtControllerError(Exception):
    """Base of every error that a person is meant to read; ends the program with `exit_code`."""

    exit_code = 1


class ConfigError(RtControllerError):
    """A setting, file or command line that is not valid."""

    exit_code = 2


class ArtifactError(RtControllerError):
    """A model bundle that is missing, damaged, or made for another controller."""

    exit_code = 2


class DatasetError(RtControllerError):
    """A data set that is missing, damaged, or generated with other settings."""

    exit_code = 2


class OutputError(RtControllerError):
    """A file or a stream of results that is incomplete; the work itself is done."""

    exit_code = 9


class MissingExtraError(RtControllerError):
    """A part of the program whose optional dependencies are not installed."""

    exit_code = 3


def install_command(extras: str) -> str:
    """The pip command that installs these extras, such as "offline,report".

    Editable if this package runs from a source checkout, otherwise by the name of the distribution.
    """
    is_checkout = (Path(__file__).parents[2] / "pyproject.toml").is_file()
    target = '-e ".' if is_checkout else '"rt-controller'
    return f'pip install {target}[{extras}]"'


@contextmanager
def needs_extra(extra: str, needed_by: str) -> Iterator[None]:
    """Turn an import that fails in this context into an error that names the extra.

    Raises:
        MissingExtraError: a package is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"{needed_by} needs {error.name}: expected the extra [{extra}], found it missing. "
            f"Install it with: {install_command(extra)}"
        ) from error


def require_packages(extra: str, packages: Iterable[str], needed_by: str) -> None:
    """Check that the packages of an extra are installed, without importing them.

    Raises:
        MissingExtraError: one is missing.
    """
    with needs_extra(extra, needed_by):
        for name in packages:
            if find_spec(name) is None:
                raise ModuleNotFoundError(name=name)


class BusError(RtControllerError):
    """A CAN bus that cannot be opened, or a peer with another message catalogue."""

    exit_code = 5


class ControlLawError(RtControllerError):
    """A control law that raised an exception, or returned no input; the car was stopped."""

    exit_code = 6


class PlantError(RtControllerError):
    """A simulated car that raised an exception, or whose motion stopped being finite."""

    exit_code = 7


def require_type(name: str, found: object, kind: type | UnionType, expected: str) -> None:
    """Return if an argument is of this type.

    Raises:
        TypeError: it is not.
    """
    if not isinstance(found, kind):
        raise TypeError(f"{name}: expected {expected}, found {found!r:.60}.")
