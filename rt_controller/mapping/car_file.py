"""A mapping file for driving, with the DBC and the reference line that it names."""

from pathlib import Path
from typing import NamedTuple

from cantools.database.can import Database
from pydantic import TypeAdapter

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import read_text
from rt_controller.mapping.dbc_signals import load_dbc
from rt_controller.mapping.reference_line import ReferenceLine, read_line
from rt_controller.mapping.tables import DrivingMapping
from rt_controller.mapping.toml_file import parse


class CarFile(NamedTuple):
    """What `read_car` returns."""

    path: Path
    mapping: DrivingMapping
    database: Database
    line: ReferenceLine | None


def read_car(path: Path) -> CarFile:
    """The mapping in a TOML file, its DBC and its line. Paths in it are relative to the file.

    Raises:
        ConfigError: a file cannot be read, or fields are missing, unknown or wrong; all such fields
            are named at once.
        DatasetError: the reference line is damaged.
    """
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{path}: expected a mapping file in TOML, found nothing readable "
            f"({error}). docs/own-car.md has one to start from."
        ) from error
    mapping = parse(text, TypeAdapter(DrivingMapping), str(path), context=path.parent)
    database = load_dbc(mapping.can.dbc)
    known = {message.name for message in database.messages}
    unknown = [name for name in mapping.messages if name not in known]
    if unknown:
        raise ConfigError(
            f"{path}: messages: expected names of messages of {mapping.can.dbc.name}, found "
            f"{', '.join(unknown)}. Correct the names of the tables [messages.NAME]."
        )
    return CarFile(path, mapping, database, read_line(mapping.pose) if mapping.pose else None)
