"""Names that a fault may use: frames and signals of the DBC, groups of frames, and actuators.

Only names are read from `messages.dbc`, so that a scenario can be checked without the bus.
"""

from collections import Counter
from collections.abc import Collection
from importlib import resources
from typing import NamedTuple

from pydantic import AfterValidator

from rt_controller.contract.names import hint
from rt_controller.contract.signals import VEHICLE, ControlInput, CurvaturePreview, PathReference

ACTUATOR = "ACTUATOR"
"""no frame: what the pedals and the steering wheel of the plant do"""
VALID = "Valid"
_FLAGS, _HEADER = (VALID, "Mode"), ("Crc", "Counter", "Cycle")
_GROUPS = {
    "state": ("STATE_A", "STATE_B", "STATE_C"),
    "reference": ("REF_PATH", "REF_SPEED"),
    "preview": ("REF_CURVATURE_A", "REF_CURVATURE_B"),
}
_ALIASES = {
    "state": (*VEHICLE.state_names, *VEHICLE.exogenous_names),
    "reference": PathReference._fields,
    "preview": CurvaturePreview._fields,
}
"""fields of the contract in the order of the signals of a group; their units are the same"""


class FrameNames(NamedTuple):
    """A frame of the DBC, or the actuators."""

    number: int  # its arbitration id
    sender: str
    values: tuple[str, ...]  # the flag beside the counter, Valid or Mode, and the signals


class SignalName(NamedTuple):
    """One signal of one frame."""

    frame: str
    signal: str


def signals_of(frame: str) -> list[SignalName]:
    """All of a frame, without CRC, counter and flag."""
    return [SignalName(frame, name) for name in FRAMES[frame].values if name not in _FLAGS]


def name_in(known: Collection[str], expected: str = "") -> AfterValidator:
    """Refuse all other names; the message says what is `expected` in place of a long list."""

    def check(name: str) -> str:
        if name not in known:
            wanted = expected or f"one of {', '.join(known)}"
            raise ValueError(f"expected {wanted}, found {name!r}{hint(name, known)}")
        return name

    return AfterValidator(check)


def _frames_of_the_dbc() -> dict[str, FrameNames]:
    text = (resources.files("rt_controller.contract") / "messages.dbc").read_text("ascii")
    found = {}
    for block in text.split("\nBO_ ")[1:]:
        head, *lines = block.splitlines()
        number, name, _, sender = head.split()
        names = [line.split()[1] for line in lines if line.startswith(" SG_ ")]
        values = tuple(each for each in names if each not in _HEADER)
        found[name.rstrip(":")] = FrameNames(int(number), sender, values)
    return found


_DBC = _frames_of_the_dbc()
FRAMES = {ACTUATOR: FrameNames(-1, "", ControlInput._fields)} | _DBC
MESSAGES = {"all": tuple(_DBC)} | _GROUPS | {name: (name,) for name in _DBC}
"""frames by what a fault calls them: all, a node, a group, or one frame"""
for _node in ("VEHICLE", "CONTROLLER"):
    MESSAGES[_node.lower()] = tuple(name for name in _DBC if _DBC[name].sender == _node)
_ALL = [SignalName(frame, name) for frame, names in FRAMES.items() for name in names.values]
_USES = Counter(entry.signal for entry in _ALL)
SIGNALS = {".".join(entry): entry for entry in _ALL}
"""by its name, with the frame where several have it, and by the field of the contract"""
SIGNALS |= {entry.signal: entry for entry in _ALL if _USES[entry.signal] == 1}
for _group, _fields in _ALIASES.items():
    _entries = [entry for frame in _GROUPS[_group] for entry in signals_of(frame)]
    SIGNALS |= dict(zip(_fields, _entries, strict=False))
