"""A mapping file for driving, with the DBC and the reference line that it names.

A column is a signal's name, or "Message.Signal" if several messages have a signal of that name.
"""

from pathlib import Path
from typing import NamedTuple

import cantools
from cantools.database.can import Database, Message, Signal
from pydantic import TypeAdapter

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import LARGEST_TEXT_BYTES, open_regular, read_text
from rt_controller.contract.names import columns_of
from rt_controller.mapping.reference_line import ReferenceLine, read_line
from rt_controller.mapping.tables import DrivingMapping
from rt_controller.mapping.toml_file import parse


class Source(NamedTuple):
    """A signal and the message that has it."""

    message: Message
    signal: Signal


def load_dbc(path: Path) -> Database:
    """The database of a DBC (or of another file that cantools reads).

    Raises:
        ConfigError: the file is missing or cannot be parsed.
    """
    found = "a database of another kind"
    try:
        with open_regular(path, LARGEST_TEXT_BYTES) as opened:
            text = opened.read()
        # Some editors write UTF-8 instead of the encoding of DBC files.
        encoding = None
        if path.suffix.lower() == ".dbc":
            encoding = "cp1252" if "\ufffd" in text.decode("utf-8", "replace") else "utf-8"
        database = cantools.database.load_file(path, encoding=encoding)
        if isinstance(database, Database):
            return database
    except OSError as error:
        found = f"nothing readable ({error.strerror})"
    except (cantools.Error, ValueError) as error:
        found = f"a file that cannot be parsed ({error})"
    raise ConfigError(f"{path}: expected a DBC, found {found}. Correct [can] dbc.")


def find_source(where: str, database: Database, column: str) -> Source:
    """The signal that a column of the mapping names.

    Raises:
        ConfigError: none or several have this name; the message starts with `where`.
    """
    known = {
        f"{message.name}.{signal.name}": Source(message, signal)
        for message in database.messages
        for signal in message.signals
    }
    fits = [name for name, (_, signal) in known.items() if column in (name, signal.name)]
    if len(fits) == 1:
        return known[fits[0]]
    if fits:
        raise ConfigError(
            f"{where}, column {column}: expected a signal of one message, found it in "
            f"{len(fits)}. Write one of {', '.join(fits)} in the mapping."
        )
    names = [*known, *(signal.name for _, signal in known.values())]
    raise ConfigError(
        f"{where}: expected a column {column!r}, found none of that name. "
        f"{columns_of('DBC', column, names)} Name the column in the mapping as the DBC does."
    )


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
