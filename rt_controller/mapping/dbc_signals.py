"""Signals of a person's own DBC: reading the file, and finding a column of a mapping in it.

A column is a signal's name, or "Message.Signal" if several messages have a signal of that name.
"""

from pathlib import Path
from typing import NamedTuple

import cantools
from cantools.database.can import Database, Message, Signal

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import LARGEST_TEXT_BYTES, open_regular
from rt_controller.contract.names import columns_of


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
            encoding = _encoding_of(opened.read()) if path.suffix.lower() == ".dbc" else None
        database = cantools.database.load_file(path, encoding=encoding)
        if isinstance(database, Database):
            return database
    except OSError as error:
        found = f"nothing readable ({error.strerror})"
    except (cantools.Error, ValueError) as error:
        found = f"a file that cannot be parsed ({error})"
    raise ConfigError(f"{path}: expected a DBC, found {found}. Correct [can] dbc.")


def _encoding_of(text: bytes) -> str:
    """UTF-8, which some editors write, where the bytes are that; otherwise that of DBC files."""
    try:
        text.decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


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
