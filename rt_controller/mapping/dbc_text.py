"""The messages of a DBC, read one by one: a defect in one of them is none of the others.

cantools refuses a file as a whole. Here each message is parsed alone, with the statements that say
what its bits mean; comments, nodes, environment variables and signal groups are left out.
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

from cantools.database.can import Database, Message

_COMMENT = re.compile(r'^[ \t]*CM_\s[\w\s]*"(?:\\"|[^"])*?"\s*;', re.MULTILINE)
"""one whose text is closed; it may have lines that look like statements"""
_STATEMENT = re.compile(r"(?:^|(?<=;))[ \t]*(?=(?:[A-Z][A-Z_]*_|VERSION)(?!\w))", re.MULTILINE)
"""beginning of a statement, also of an unknown kind; one without its end does not hide the next"""
_HEAD = re.compile(r"\s*BO_\s+(?P<identifier>\w+)\s+(?P<name>[^\s:]+)\s*:")
_SIGNAL = re.compile(r"\s*SG_\s+(?P<name>[^\s:]+)")
_MEANING = re.compile(r"\s*(?:VAL_|SIG_VALTYPE_|SG_MUL_VAL_)\s+(?P<identifier>\d+)\s+(?P<name>\w+)")
_ATTRIBUTES = (
    *("GenMsgCycleTime", "GenSigStartValue", "VFrameFormat", "SPN"),
    *("SystemMessageLongSymbol", "SystemSignalLongSymbol"),
)
"""that change what is read or sent"""
_DEFINITION = re.compile(r'\s*BA_DEF_(?:DEF_)?\s+(?:\w+\s+)?"(?P<attribute>\w+)"')
_VALUE = re.compile(r'\s*BA_\s+"(?P<attribute>\w+)"\s+(?:BO_|SG_)\s+(?P<identifier>\d+)\s')
_ANY_MESSAGE = "BO_ 1 Any: 8 Vector__XXX\n"
"""of a DBC in which a definition of an attribute is tried"""
_SYNTAX = re.compile(r"^Invalid syntax at line \d+, column \d+: ")


class Defect(NamedTuple):
    """Why a message cannot be read."""

    message: str
    reason: str
    signals: tuple[str, ...]
    """names that it has in the file"""


def read_messages(text: str) -> tuple[list[Message], list[Defect]]:
    """The messages of a DBC that can be read, and why the others cannot."""
    blocks: list[list[str]] = []
    others: list[str] = []
    between: list[str] = []
    text = _COMMENT.sub("CM_ ", text)
    begins = [found.start() for found in _STATEMENT.finditer(text)]
    for begin, end in pairwise([*begins, len(text)]):
        statement = text[begin:end]
        keyword = statement.split(None, 1)[0]
        if keyword == "BO_":
            blocks.append([statement])
        elif keyword == "SG_" and blocks:  # what stands between two signals is a defect of theirs
            blocks[-1] += [*between, statement]
        else:
            between.append(statement)
            others.append(statement)
            continue
        between = []
    definitions, values, meanings = _sorted(others)
    good: list[Message] = []
    bad: list[Defect] = []
    for block in blocks:
        names = tuple(found["name"] for each in block if (found := _SIGNAL.match(each)))
        head = _HEAD.match(block[0])
        identifier = head["identifier"] if head else ""
        own = [each for name, each in meanings[identifier] if name in names]
        plain = "\n".join([*block, *own])
        complete = "\n".join([*definitions, plain, *values[identifier]])
        for content in (complete, plain):
            read, reason = _parsed(content)
            if read is not None:
                good += read
                break
        else:
            title = head["name"] if head else " ".join(block[0].split())[:40]
            bad.append(Defect(title, reason, names))
    return good, bad


def without_repeated(
    messages: Sequence[Message], defects: Sequence[Defect]
) -> tuple[list[Message], list[Defect]]:
    """The same, without messages whose name or whose signals' names occur twice."""
    of_name: dict[str, list[Message]] = defaultdict(list)
    for message in messages:
        of_name[message.name].append(message)
    good: list[Message] = []
    bad = list(defects)
    for name, found in of_name.items():
        signals = tuple(signal.name for each in found for signal in each.signals)
        last = found[-1]
        twice = [signal.name for signal in last.signals]
        twice = sorted({each for each in twice if twice.count(each) > 1})
        if len({_layout(each) for each in found}) > 1 or any(name == each[0] for each in defects):
            reason = "several messages of this name, which differ"
        elif twice:
            reason = f"several signals {', '.join(twice)}"
        else:
            good.append(last)
            continue
        bad.append(Defect(name, reason, signals))
    return good, bad


def _sorted(
    statements: Iterable[str],
) -> tuple[list[str], dict[str, list[str]], dict[str, list[tuple[str, str]]]]:
    """Definitions of attributes, and by identifier their values, and meanings of signals."""
    definitions: dict[str, list[str]] = defaultdict(list)
    values: dict[str, list[str]] = defaultdict(list)
    meanings: dict[str, list[tuple[str, str]]] = defaultdict(list)
    set_values = []
    for statement in statements:
        if found := _MEANING.match(statement):
            meanings[found["identifier"]].append((found["name"], statement))
        elif (found := _DEFINITION.match(statement)) and found["attribute"] in _ATTRIBUTES:
            definitions[found["attribute"]].append(statement)
        elif found := _VALUE.match(statement):
            set_values.append((found["attribute"], found["identifier"], statement))
    usable = {
        name: own for name, own in definitions.items() if _parsed(_ANY_MESSAGE + "".join(own))[0]
    }
    for attribute, identifier, statement in set_values:
        if attribute in usable:
            values[identifier].append(statement)
    return [each for own in usable.values() for each in own], values, meanings


def _parsed(text: str) -> tuple[list[Message] | None, str]:
    """The messages of a whole DBC, or why it has none."""
    database = Database()
    try:
        database.add_dbc_string(text)
    except Exception as error:  # cantools raises many types, which it does not document
        reason = str(error) or repr(error)
        reason = _SYNTAX.sub("syntax error at >>!<< in ", " ".join(reason.split()))
        return None, reason.rstrip(".")
    return database.messages, ""


def _layout(message: Message) -> tuple[object, ...]:
    """What decides how frames are read; equal for repeated statements."""
    signals = (
        (s.name, s.start, s.length, s.byte_order, s.is_signed, s.is_float, s.scale, s.offset)
        for s in message.signals
    )
    return message.frame_id, message.is_extended_frame, message.length, *signals
