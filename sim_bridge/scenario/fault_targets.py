"""Names that a fault may use: frames and signals of the DBC, groups of frames, and actuators.

The names come from `messages.dbc`; this module reads nothing else of it, so that a scenario can be
checked without the bus.
"""

import re
from collections.abc import Mapping
from functools import cache
from importlib import resources
from itertools import chain
from typing import NamedTuple

from rt_controller.contract.names import hint
from rt_controller.contract.signals import (
    EXOGENOUS_FIELDS,
    ControlInput,
    CurvaturePreview,
    PathReference,
    VehicleState,
)

ACTUATOR = "ACTUATOR"
"""no frame: what the pedals and the steering wheel of the plant do"""
GROUPS = {
    "state": ("STATE_A", "STATE_B", "STATE_C"),
    "reference": ("REF_PATH", "REF_SPEED"),
    "preview": ("REF_CURVATURE_A", "REF_CURVATURE_B"),
}
_HEADER = ("Crc", "Counter", "Cycle")
VALID = "Valid"
_FLAGS = (VALID, "Mode")
_ALIASES = (
    ("state", (*VehicleState._fields, *EXOGENOUS_FIELDS)),
    ("reference", PathReference._fields),
    ("preview", CurvaturePreview._fields),
)
"""fields of the contract in the order of the signals of a group; their units are the same"""


class FrameNames(NamedTuple):
    """A frame of the DBC."""

    sender: str
    flag: str
    """the signal beside the counter: Valid or Mode"""
    signals: tuple[str, ...]


class SignalName(NamedTuple):
    """One signal of one frame."""

    frame: str
    signal: str


@cache
def known_frames() -> Mapping[str, FrameNames]:
    """All frames of `messages.dbc` by name, and the actuators."""
    text = (resources.files("rt_controller.contract") / "messages.dbc").read_text("ascii")
    frames = {ACTUATOR: FrameNames("", "", ControlInput._fields)}
    for block in re.split(r"^BO_ ", text, flags=re.MULTILINE)[1:]:
        head, *lines = block.splitlines()
        _, name, _, sender = head.split()
        found = [line.split()[1] for line in lines if line.startswith(" SG_ ")]
        flag = next((each for each in found if each in _FLAGS), "")
        signals = tuple(each for each in found if each not in (*_HEADER, *_FLAGS))
        frames[name.rstrip(":")] = FrameNames(sender, flag, signals)
    return frames


def frames_of(name: str) -> tuple[str, ...]:
    """The frames that a name stands for: itself, a group, a node, or all.

    Raises:
        ValueError: no such name.
    """
    frames = {each: names for each, names in known_frames().items() if each != ACTUATOR}
    if name in frames:
        return (name,)
    if name == "all":
        return tuple(frames)
    if name in GROUPS:
        return GROUPS[name]
    sent = tuple(each for each, names in frames.items() if names.sender.lower() == name)
    if sent:
        return sent
    known = ("all", "vehicle", "controller", *GROUPS, *frames)
    raise ValueError(f"expected one of {', '.join(known)}, found {name!r}{hint(name, set(known))}")


@cache
def _signals_by_name() -> Mapping[str, tuple[SignalName, ...]]:
    found: dict[str, tuple[SignalName, ...]] = {}
    for frame, names in known_frames().items():
        for signal in (*names.signals, *([names.flag] if names.flag else [])):
            entry = SignalName(frame, signal)
            found[f"{frame}.{signal}"] = (entry,)
            found[signal] = (*found.get(signal, ()), entry)
    for group, fields in _ALIASES:
        entries = [found[f"{frame}.{s}"] for frame in GROUPS[group] for s in signals_of(frame)]
        found |= dict(zip(fields, entries, strict=False))
    return found


def signals_of(frame: str) -> tuple[str, ...]:
    """The signals of a frame, without CRC, counter and flag."""
    return known_frames()[frame].signals


def signal_named(name: str) -> SignalName:
    """The signal that a name stands for: VelocityX, STATE_A.VelocityX or vx_mps.

    Raises:
        ValueError: no such name, or several frames have it.
    """
    found = _signals_by_name().get(name, ())
    if len(found) == 1:
        return found[0]
    if found:
        names = ", ".join(".".join(each) for each in found)
        raise ValueError(f"expected the frame too ({names}), found {name!r}")
    fields = chain.from_iterable(fields for _, fields in _ALIASES)
    known = {*_signals_by_name(), *fields}
    raise ValueError(
        f"expected a signal of messages.dbc, such as VelocityX or STATE_A.VelocityX, or a field of "
        f"the contract, such as vx_mps, found {name!r}{hint(name, known)}"
    )
