"""A mapping file for driving, with the DBC and the reference line that it names.

A column is a signal's name, or "Message.Signal" if several messages have a signal of that name.
"""

import codecs
import logging
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import cantools
from cantools.database.can import Database, Message, Signal
from pydantic import TypeAdapter

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import LARGEST_TEXT_BYTES, open_regular
from rt_controller.contract.names import columns_of
from rt_controller.mapping.dbc_text import Defect, read_messages, without_repeated
from rt_controller.mapping.reference_line import ReferenceLine, read_line
from rt_controller.mapping.tables import DrivingMapping
from rt_controller.mapping.toml_file import parse, read_own

_KINDS = ("dbc", "kcd", "sym", "arxml")


class Source(NamedTuple):
    """A signal and the message that has it."""

    message: Message
    signal: Signal


class CarDatabase(Database):
    """The messages of a DBC that can be read, and why the others cannot."""

    def __init__(self, messages: list[Message], defects: Sequence[Defect], where: str) -> None:
        super().__init__(messages)
        self.defects = {each.message: each for each in defects}
        """by name of the message"""
        self.is_fd = any(message.is_fd for message in messages)
        """the bus of the car carries frames of CAN FD"""
        self.note = ""
        """one line for the user if there are defects"""
        if defects:
            count, first = len(messages) + len(defects), defects[0]
            self.note = (
                f"{where}: {len(defects)} of {count} messages cannot be read (first: "
                f"{first.message}: {first.reason}); they are not mapped"
            )


def load_dbc(path: Path) -> CarDatabase:
    """The database of a DBC (or of another file that cantools reads).

    A defect in one message of a DBC does not refuse the others; see `CarDatabase.defects`.

    Raises:
        ConfigError: the file is missing or cannot be parsed.
    """
    try:
        with open_regular(path, LARGEST_TEXT_BYTES) as opened:
            return _parsed(path, opened.read())
    except OSError as error:
        found = f"nothing readable ({error.strerror})"
    except (cantools.Error, ValueError) as error:
        found = f"a file that cannot be parsed ({error})"
    raise ConfigError(f"{path}: expected a DBC, found {found}. Correct [can] dbc.")


@lru_cache(maxsize=2)
def _parsed(path: Path, content: bytes) -> CarDatabase:
    """The database of a file; cached because each log of an import asks for it."""
    text, defects = _decoded(content), list[Defect]()
    # It warns of identifiers and names that occur twice, also of messages that are not mapped.
    logging.getLogger("cantools").setLevel(logging.ERROR)
    kind = path.suffix.lower().removeprefix(".")
    try:
        database = cantools.database.load_string(text, kind if kind in _KINDS else None)
        if not isinstance(database, Database):
            raise ValueError("a database of another kind")
        messages = database.messages
    except cantools.Error:
        if kind in _KINDS[1:]:
            raise
        messages, defects = read_messages(text)
        if not messages and not defects:
            raise
    if kind not in _KINDS[1:]:  # other formats have pages of the same name
        messages, defects = without_repeated(messages, defects)
    return CarDatabase(messages, defects, path.name)


def _decoded(content: bytes) -> str:
    """The text; some editors write UTF-8 or UTF-16 instead of the encoding of DBC files."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = content.decode("utf-16", "replace")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = content.decode("cp1252", "replace")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def find_source(where: str, database: Database, column: str) -> Source:
    """The signal that a column of the mapping names.

    Raises:
        ConfigError: none or several have this name, or its message has a defect; the text starts
            with `where`.
    """
    defects = database.defects if isinstance(database, CarDatabase) else {}
    known = {
        f"{message.name}.{signal.name}": Source(message, signal)
        for message in database.messages
        for signal in message.signals
    }
    unread = {f"{m}.{name}": name for m, each in defects.items() for name in each.signals}
    fits = [name for name, (_, signal) in known.items() if column in (name, signal.name)]
    fits += [name for name, signal in unread.items() if column in (name, signal)]
    if len(fits) == 1 and fits[0] in known:
        return known[fits[0]]
    if len(fits) > 1:
        raise ConfigError(
            f"{where}, column {column}: expected a signal of one message, found it in "
            f"{len(fits)}. Write one of {', '.join(fits)} in the mapping."
        )
    message = (fits or [column])[0].partition(".")[0]
    if message in defects:
        raise ConfigError(f"{where}, column {column}: {_explain(defects[message])}")
    names = [*known, *(signal.name for _, signal in known.values())]
    raise ConfigError(
        f"{where}: expected a column {column!r}, found none of that name. "
        f"{columns_of('DBC', column, names)} Name the column in the mapping as the DBC does."
    )


def _explain(defect: Defect) -> str:
    return (
        f"expected a message that can be read, found {defect.message}: {defect.reason}. Correct "
        f"it in the DBC; messages that are not mapped may stay as they are."
    )


class CarFile(NamedTuple):
    """What `read_car` returns."""

    path: Path
    mapping: DrivingMapping
    database: CarDatabase
    line: ReferenceLine | None


FOR_DRIVING = "A mapping for driving has this table: docs/own-car.md."


def read_car(path: Path) -> CarFile:
    """The mapping in a TOML file, its DBC and its line. Paths in it are relative to the file.

    Raises:
        ConfigError: a file cannot be read, or fields are missing, unknown or wrong; all such fields
            are named at once.
        DatasetError: the reference line is damaged.
    """
    text = read_own(path, "mapping", "docs/own-car.md has one to start from.")
    remedies = dict.fromkeys(("commands", "reference", "mission"), FOR_DRIVING)
    mapping = parse(text, TypeAdapter(DrivingMapping), str(path), path.parent, remedies)
    database = load_dbc(mapping.can.dbc)
    known = {message.name for message in database.messages}
    unknown = [name for name in mapping.messages if name not in known]
    for name in unknown:
        if name in database.defects:
            raise ConfigError(f"{path}: messages.{name}: {_explain(database.defects[name])}")
    if unknown:
        raise ConfigError(
            f"{path}: messages: expected names of messages of {mapping.can.dbc.name}, found "
            f"{', '.join(unknown)}. Correct the names of the tables [messages.NAME]."
        )
    return CarFile(path, mapping, database, read_line(mapping.pose) if mapping.pose else None)
