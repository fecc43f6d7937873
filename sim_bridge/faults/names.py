"""Names that a fault may use: frames and signals of the DBC, groups of frames, and actuators.

The names come from `messages.dbc`; this module reads nothing else of it, so that a scenario can be
checked without the bus.
"""

import re
from collections.abc import Mapping
from functools import cache
from importlib import resources
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
VALID = "Valid"
_FLAGS, _HEADER = (VALID, "Mode"), ("Crc", "Counter", "Cycle")
GROUPS = {
    "state": ("STATE_A", "STATE_B", "STATE_C"),
    "reference": ("REF_PATH", "REF_SPEED"),
    "preview": ("REF_CURVATURE_A", "REF_CURVATURE_B"),
}
_ALIASES = {
    "state": (*VehicleState._fields, *EXOGENOUS_FIELDS),
    "reference": PathReference._fields,
    "preview": CurvaturePreview._fields,
}
"""fields of the contract in the order of the signals of a group; their units are the same"""


class FrameNames(NamedTuple):
    """A frame of the DBC."""

    number: int
    """its arbitration id"""
    sender: str
    flag: str
    """the signal beside the counter: Valid or Mode"""
    signals: tuple[str, ...]
    """without CRC, counter and flag"""

    @property
    def values(self) -> tuple[str, ...]:
        """The flag, if there is one, and the signals."""
        return (self.flag, *self.signals) if self.flag else self.signals


class SignalName(NamedTuple):
    """One signal of one frame."""

    frame: str
    signal: str


@cache
def known_frames() -> Mapping[str, FrameNames]:
    """All frames of `messages.dbc` by name, and the actuators."""
    text = (resources.files("rt_controller.contract") / "messages.dbc").read_text("ascii")
    frames = {ACTUATOR: FrameNames(-1, "", "", ControlInput._fields)}
    for block in re.split(r"^BO_ ", text, flags=re.MULTILINE)[1:]:
        head, *lines = block.splitlines()
        number, name, _, sender = head.split()
        found = [line.split()[1] for line in lines if line.startswith(" SG_ ")]
        flag = next((each for each in found if each in _FLAGS), "")
        signals = tuple(each for each in found if each not in (*_HEADER, *_FLAGS))
        frames[name.rstrip(":")] = FrameNames(int(number), sender, flag, signals)
    return frames


def frames_of(name: str) -> tuple[str, ...]:
    """The frames that a name stands for: itself, a group, a node, or all.

    Raises:
        ValueError: no such name.
    """
    frames = {each: names.sender for each, names in known_frames().items() if each != ACTUATOR}
    known: dict[str, tuple[str, ...]] = {"all": tuple(frames)}
    for node in ("vehicle", "controller"):
        known[node] = tuple(each for each, sender in frames.items() if sender.lower() == node)
    known |= GROUPS | {each: (each,) for each in frames}
    if name not in known:
        raise ValueError(f"expected one of {', '.join(known)}, found {name!r}{hint(name, known)}")
    return known[name]


@cache
def _signals_by_name() -> Mapping[str, tuple[SignalName, ...]]:
    found: dict[str, tuple[SignalName, ...]] = {}
    for frame, names in known_frames().items():
        for signal in names.values:
            entry = SignalName(frame, signal)
            found[f"{frame}.{signal}"] = (entry,)
            found[signal] = (*found.get(signal, ()), entry)
    for group, fields in _ALIASES.items():
        signals = [(f, s) for f in GROUPS[group] for s in known_frames()[f].signals]
        found |= {name: (SignalName(*each),) for name, each in zip(fields, signals, strict=False)}
    return found


def signal_named(name: str) -> SignalName:
    """The signal that a name stands for: VelocityX, STATE_A.VelocityX or vx_mps.

    Raises:
        ValueError: no such name, or several frames have it.
    """
    known = _signals_by_name()
    found = known.get(name, ())
    if len(found) > 1:
        names = ", ".join(".".join(each) for each in found)
        raise ValueError(f"expected the frame too ({names}), found {name!r}")
    if not found:
        raise ValueError(
            f"expected a signal of messages.dbc, such as VelocityX or STATE_A.VelocityX, or a "
            f"field of the contract, such as vx_mps, found {name!r}{hint(name, known)}"
        )
    return found[0]
