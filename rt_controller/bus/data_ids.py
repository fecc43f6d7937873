"""The data ids of the end-to-end protection: check those of a bus, choose some for a new message.

AUTOSAR profile 22 gives each message 16 bytes, one for each counter, "appropriately chosen"
against frames under a wrong identifier. Here that means three rules:

1. Under one counter all messages of the bus have different data ids.
2. In each message every error of one or two bits is detected, also one that changes the counter
   and with it the data id.
3. Eight bytes 0x00 and eight bytes 0xFF are not an intact frame of any message.

Commands: `python -m rt_controller.bus.data_ids --help`.
"""

import sys
from argparse import ArgumentParser
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from random import Random

from cantools.database.can import Message

from rt_controller.bus.codec import COUNTER_MASK, FRAME_LENGTH, crc8
from rt_controller.bus.dbc import DATA_IDS_ATTRIBUTE, DBC_PATH, data_ids_of, read_dbc
from rt_controller.contract.errors import ConfigError, RtControllerError
from rt_controller.contract.timing import COUNTER_MODULUS

_DATA_IDS = range(256)
_COUNTER_PLACE = 8
"""bit of the frame at which the counter begins"""
_ENCODING = "cp1252"
"""of DBC files that other tools write; ASCII is a part of it"""
_RULES = (
    "Under one counter all messages have different data ids.",
    "In each message every error of one or two bits is detected.",
    "Eight bytes 0x00 and eight bytes 0xFF are not an intact frame.",
)


def _undetected_differences() -> dict[int, set[int]]:
    """For each error of the counter: the differences of data ids that leave an error undetected.

    Both are exclusive ors. The CRC is linear, so one frame stands for all.
    """
    zeros = bytes(FRAME_LENGTH)
    difference_of = {crc8(zeros, data_id) ^ crc8(zeros, 0): data_id for data_id in _DATA_IDS}
    undetected: dict[int, set[int]] = {}
    for n_bits in (1, 2):
        for bits in combinations(range(8 * FRAME_LENGTH), n_bits):
            word = sum(1 << bit for bit in bits)
            error = word.to_bytes(FRAME_LENGTH, "little")
            crc_change = crc8(error, 0) ^ crc8(zeros, 0) ^ error[0]
            counter_error = word >> _COUNTER_PLACE & COUNTER_MASK
            undetected.setdefault(counter_error, set()).add(difference_of[crc_change])
    return undetected


_UNDETECTED = _undetected_differences()


def find_objection(ids: Sequence[int], others: Mapping[str, Sequence[int]]) -> str | None:
    """The reason why the last of these data ids of a message breaks a rule; None if it does not.

    Args:
        ids: of the counters 0, 1, …
        others: data ids of the other messages of the bus by name.
    """
    counter, data_id = len(ids) - 1, ids[-1]
    for name, other in others.items():
        if other[counter] == data_id:
            return f"{data_id:02X} under counter {counter}, as in {name}"
    for earlier in range(counter):
        if data_id ^ ids[earlier] in _UNDETECTED.get(counter ^ earlier, ()):
            return (
                f"{ids[earlier]:02X} and {data_id:02X} under the counters {earlier} and {counter}, "
                f"so that an error of one or two bits is not detected"
            )
    for byte in (0x00, 0xFF):
        is_of_counter = byte & COUNTER_MASK == counter
        if is_of_counter and crc8(bytes([byte]) * FRAME_LENGTH, data_id) == byte:
            return f"{data_id:02X} under counter {counter}, so that eight 0x{byte:02X} are intact"
    return None


def find_objections(data_ids: Mapping[str, Sequence[int]]) -> Iterator[str]:
    """One sentence for each data id that breaks a rule, of all messages of a bus by name."""
    earlier: dict[str, Sequence[int]] = {}
    for name, ids in data_ids.items():
        for counter in range(len(ids)):
            objection = find_objection(ids[: counter + 1], earlier)
            if objection is not None:
                yield f"{name}: found the data id {objection}."
        earlier[name] = ids


def choose(name: str, others: Mapping[str, Sequence[int]]) -> bytes:
    """16 data ids for a message of this name, which obey all rules; the same at every call.

    Raises:
        ConfigError: there are none; the bus has too many messages.
    """
    rng = Random(name)
    orders = [rng.sample(_DATA_IDS, len(_DATA_IDS)) for _ in range(COUNTER_MODULUS)]

    def complete(ids: list[int]) -> list[int] | None:
        if len(ids) == COUNTER_MODULUS:
            return ids
        for data_id in orders[len(ids)]:
            longer = [*ids, data_id]
            if find_objection(longer, others) is None and (found := complete(longer)) is not None:
                return found
        return None

    found = complete([])
    if found is None:
        raise ConfigError(
            f"{name}: expected 16 free data ids, found none beside {len(others)} messages. Use "
            f"another bus."
        )
    return bytes(found)


def read_data_ids(paths: Iterable[Path]) -> tuple[dict[str, bytes], dict[str, Message]]:
    """Data ids of the protected messages of DBC files, and the messages without any.

    Both by name and path of the file. Files that do not define the attribute E2EDataIdList are
    left out.

    Raises:
        ConfigError: a file is not a DBC, or a list is not 16 hexadecimal bytes.
    """
    known: dict[str, bytes] = {}
    missing: dict[str, Message] = {}
    for path in paths:
        database = read_dbc(path, _ENCODING, "a DBC file", "Correct the file, or name another.")
        if database.dbc is None or DATA_IDS_ATTRIBUTE not in database.dbc.attribute_definitions:
            continue
        for message in database.messages:
            name = f"{message.name} ({path})"
            if message.dbc is not None and DATA_IDS_ATTRIBUTE in message.dbc.attributes:
                known[name] = data_ids_of(message)
            else:
                missing[name] = message
    return known, missing


def attribute_line(identifier: int, ids: bytes) -> str:
    """The line of a DBC that gives a message its data ids."""
    return f'BA_ "E2EDataIdList" BO_ {identifier} "{ids.hex(" ").upper()}";'


def main(arguments: Sequence[str] | None = None) -> str:
    """What the command prints.

    Raises:
        ConfigError: a data id breaks a rule, or see `read_data_ids` and `choose`.
    """
    parser = ArgumentParser(
        prog="python -m rt_controller.bus.data_ids",
        description="Print the attribute line with new data ids for each message that has none.",
    )
    parser.add_argument("--check", action="store_true", help="check the data ids of all messages")
    parser.add_argument(
        "dbc", nargs="*", type=Path, help="all DBC files of one bus (default: messages.dbc)"
    )
    options = parser.parse_args(arguments)
    known, missing = read_data_ids(options.dbc or [DBC_PATH])
    objections = [
        *find_objections(known),
        *(f"{name}: found no E2EDataIdList." for name in missing if options.check),
    ]
    if objections:
        raise ConfigError(
            "\n".join(objections) + f"\nExpected of all data ids: {' '.join(_RULES)} Delete the "
            "lines of these messages from the DBC and run this command without --check."
        )
    if options.check:
        rules = "\n".join(f"- {rule}" for rule in _RULES)
        return f"{len(known)} messages with 16 data ids each, no objection:\n{rules}"
    lines = []
    for name, message in missing.items():
        known[name] = choose(message.name, known)
        lines.append(attribute_line(message.frame_id, known[name]))
    return "\n".join(lines) or (
        f"All {len(known)} messages have data ids. Add the lines of the new message (BO_, SG_) to "
        f"the DBC first."
    )


if __name__ == "__main__":
    try:
        print(main())
    except RtControllerError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
