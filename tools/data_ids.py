"""The data ids of the end-to-end protection: check those of a bus, choose some for a new message.

AUTOSAR profile 22 gives each message 16 bytes, one for each counter, "appropriately chosen"
against frames under a wrong identifier. Here that means three rules:

1. Under one counter all messages of the bus have different data ids.
2. In each message every error of one or two bits is detected, also one that changes the counter
   and with it the data id.
3. Eight bytes 0x00 and eight bytes 0xFF are not an intact frame of any message.

`python tools/data_ids.py [DBC ...]` checks the DBC files of one bus (default:
messages.dbc), and prints the attribute line of each message that has no data ids.
"""

import sys
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from random import Random

from rt_controller.bus.codec import COUNTER_MASK, FRAME_LENGTH, crc8
from rt_controller.bus.dbc import DATA_IDS_ATTRIBUTE, DBC_PATH, data_ids_of, read_dbc
from rt_controller.contract.errors import ConfigError, RtControllerError
from rt_controller.contract.timing import COUNTER_MODULUS

_DATA_IDS = range(256)
_COUNTER_PLACE = 8
"""bit of the frame at which the counter begins"""
_ENCODING = "cp1252"
"""of DBC files that other tools write; ASCII is a part of it"""


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
    """Which rule the last of these data ids of a message breaks; None if none.

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


def new_lines(paths: Sequence[Path]) -> list[str]:
    """The DBC line with data ids for each message that has none, in the DBC files of one bus.

    Files that do not define the attribute E2EDataIdList count as other tools' and are left out.

    Raises:
        ConfigError: a data id breaks a rule.
    """
    known, missing = {}, []
    for path in paths:
        database = read_dbc(path, _ENCODING)
        if database.dbc is None or DATA_IDS_ATTRIBUTE not in database.dbc.attribute_definitions:
            continue
        for message in database.messages:
            has_ids = message.dbc is not None and DATA_IDS_ATTRIBUTE in message.dbc.attributes
            if has_ids:
                known[f"{message.name} ({path})"] = data_ids_of(message)
            else:
                missing.append(message)
    objections = list(find_objections(known))
    if objections:
        raise ConfigError(
            "\n".join(objections) + "\nExpected data ids that obey the rules of "
            "tools/data_ids.py. Delete the lines of these messages from the DBC and "
            "run this command again."
        )
    lines = []
    for message in missing:
        ids = known[message.name] = choose(message.name, known)
        lines.append(f'BA_ "{DATA_IDS_ATTRIBUTE}" BO_ {message.frame_id} "{ids.hex(" ").upper()}";')
    return lines


if __name__ == "__main__":
    try:
        chosen = new_lines([Path(name) for name in sys.argv[1:]] or [DBC_PATH])
        print("\n".join(chosen) or "All messages have data ids, and all obey the rules.")
    except RtControllerError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
