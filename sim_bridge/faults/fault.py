"""A fault: what is wrong on the bus or at an actuator, when and for how long, as in a file.

A kind of fault is one entry of `KINDS`; `docs/faults.md` describes it, `docs/safety.md` lists how
controller and vehicle react.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from math import ceil
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from rt_controller.contract.timing import LONGEST_S, PERIOD_MS, PERIOD_S
from sim_bridge.faults.names import MESSAGES, SIGNALS, SignalName, name_in, signals_of
from sim_bridge.toml_file import FileTable, Number, entries


class Sample(NamedTuple):
    """One value of a frame, or of the actuators, in a period in which a fault acts."""

    value: float  # as earlier faults left it
    amount: float  # `value` of the fault; without one the value at its beginning
    held: float  # at the beginning of the fault
    late: float  # of `delay_s` before, without any fault
    last: float  # that was left in the period before
    periods: int  # since the beginning, this one included
    rng: np.random.Generator


class Kind(NamedTuple):
    """What a fault of this kind needs and does: it changes values, or frames, or adds frames."""

    targets: tuple[str, ...]  # fields that say what it acts on: one of them is needed
    needs: tuple[str, ...] = ()
    may: tuple[str, ...] = ()  # fields that may be left out; all others are refused
    change: Callable[[Sample], float] | None = None
    least_ticks: int = 1  # shortest fault that has an effect
    is_positive: bool = False  # `value` is larger than 0


def _limited(s: Sample) -> float:
    change = s.amount * PERIOD_S
    return min(max(s.value, s.last - change), s.last + change)


_SIGNALS, _FRAMES = ("signals", "messages"), ("messages",)
_VALUE, _DELAY = ("value",), ("delay_s",)
THIRD_PARTICIPANT, JITTER = "masquerade", "jitter"
KINDS = {
    # When the state is sampled; see `Bridge`.
    JITTER: Kind((), _VALUE, is_positive=True),
    # Values of signals, in frames that are otherwise correct.
    "lag": Kind(_SIGNALS, _DELAY, change=lambda s: s.late),
    "freeze": Kind(_SIGNALS, change=lambda s: s.held, least_ticks=2),
    "stuck": Kind(("signals",), may=_VALUE, change=lambda s: s.amount),
    "scale": Kind(_SIGNALS, _VALUE, change=lambda s: s.value * s.amount),
    "bias": Kind(_SIGNALS, _VALUE, change=lambda s: s.value + s.amount),
    "drift": Kind(_SIGNALS, _VALUE, change=lambda s: s.value + s.amount * PERIOD_S * s.periods),
    "noise": Kind(_SIGNALS, _VALUE, change=lambda s: s.value + s.amount * s.rng.standard_normal()),
    "quantise": Kind(
        _SIGNALS, _VALUE, change=lambda s: round(s.value / s.amount) * s.amount, is_positive=True
    ),
    "set": Kind(_SIGNALS, _VALUE, change=lambda s: s.amount),
    "rate": Kind(_SIGNALS, _VALUE, change=_limited, is_positive=True),
    # Whole frames: whether they arrive, when, how often, with which bits; see `FrameFault`.
    "corrupt": Kind(_FRAMES, may=("probability", "count")),
    "drop": Kind(_FRAMES, may=("probability",)),
    "bus_off": Kind(()),
    "duplicate": Kind(_FRAMES, may=("probability", "count")),
    "replay": Kind(_FRAMES, _DELAY, ("probability", "replaces")),
    "reorder": Kind(_FRAMES, least_ticks=2),
    "delay": Kind(_FRAMES, _DELAY),
    "burst": Kind(_FRAMES, _DELAY),
    # Frames of the catalogue, correct in form, from a wrong sender.
    THIRD_PARTICIPANT: Kind(
        ("messages", "frame_id"), may=("count", "values", "period_s", "counter", "replaces", "data")
    ),
}
"""in the order in which they act"""
FRAME_KINDS = {kind for kind in KINDS if KINDS[kind].change is None} - {THIRD_PARTICIPANT, JITTER}
ORDER = {kind: place for place, kind in enumerate(KINDS)}

MOST_FAULTS, MOST_NAMED = 100, 3
"""in a file; frames or signals in the text of a fault"""
LONGEST_DELAY_S = 1.0
_OF_ALL = ("kind", "start_s", "duration_s", "before_drive", "seed")
_VALID_FLAGS = ["STATE_A.Valid", "STATE_B.Valid", "STATE_C.Valid"]
SHORTHANDS: dict[str, dict[str, Any]] = {
    "state_lost": {"kind": "drop", "messages": ["state"]},
    "state_invalid": {"kind": "set", "signals": _VALID_FLAGS, "value": 0.0},
    "state_frozen": {"kind": "freeze", "messages": ["STATE_A", "STATE_B"]},
    "state_delayed": {"kind": "lag", "messages": ["state"]},
    "state_offset": {"kind": "bias"},
    "state_noise": {"kind": "noise"},
    "reference_lost": {"kind": "drop", "messages": ["reference"]},
    "preview_lost": {"kind": "drop", "messages": ["preview"]},
    "mission_lost": {"kind": "drop", "messages": ["MISSION"]},
    "command_lost": {"kind": "drop", "messages": ["ACT_CMD"]},
}
"""fields that a short name stands for"""


_Message = Annotated[str, name_in(MESSAGES)]
_Signal = Annotated[
    str,
    name_in(
        SIGNALS,
        "a signal of messages.dbc, such as VelocityX, or STATE_A.Valid where several frames have "
        "the name, or a field of the contract, such as vx_mps",
    ),
]


class Fault(FileTable):
    """One fault; `docs/faults.md` describes the fields."""

    kind: Annotated[str, name_in({**KINDS, **SHORTHANDS})]
    """one of those in docs/faults.md"""
    start_s: Annotated[Number, Field(ge=0.0, le=LONGEST_S)] = 0.0
    """less than `duration_s` of the scenario"""
    duration_s: Annotated[Number, Field(gt=0.0, le=LONGEST_S)] | None = None
    """without: to the end of the drive"""
    before_drive: bool = False
    """also while the car waits for a controller"""
    messages: Annotated[tuple[_Message, ...], entries(1)] = ()
    signals: Annotated[tuple[_Signal, ...], entries(1)] = ()
    value: Number | None = None
    """in the unit of the signal in the DBC; of actuators in SI"""
    delay_s: Annotated[Number, Field(ge=PERIOD_S, le=LONGEST_DELAY_S)] = 0.0
    seed: Annotated[int, Field(ge=0, strict=True)] = 0
    probability: Annotated[Number, Field(gt=0.0, le=1.0)] = 1.0
    """of each frame to be affected"""
    count: Annotated[int, Field(ge=1, le=1000, strict=True)] = 1
    """frames that are added, or bits that are wrong"""
    values: dict[_Signal, Number] = Field(default_factory=dict)
    """of a third participant's frames; other signals are those of the last genuine frame"""
    period_s: Annotated[Number, Field(ge=PERIOD_S, le=LONGEST_S)] = PERIOD_S
    """between the frames of a third participant"""
    counter: Literal["next", "own", "same"] = "next"
    """of these frames: one after the genuine frame's, counted by itself, or the genuine one's"""
    replaces: bool = False
    """True: the genuine frames are lost"""
    frame_id: Annotated[int, Field(ge=0, le=0x1FFF_FFFF, strict=True)] | None = None
    data: Annotated[
        bytes, BeforeValidator(lambda text: bytes.fromhex(str(text))), Field(max_length=64)
    ] = b""
    """with `frame_id`: a third participant's frame that is not in the DBC"""

    @model_validator(mode="before")
    @classmethod
    def _expand(cls, fields: Any) -> Any:
        """A short name becomes its fields, and `signal` a list with one entry."""
        if not isinstance(fields, dict):
            return fields
        fields = dict(fields)
        if "signal" in fields and "signals" not in fields:
            fields["signals"] = [fields.pop("signal")]
        short = SHORTHANDS.get(str(fields.get("kind")))
        return {**short, **fields, "kind": short["kind"]} if short else fields

    @model_validator(mode="after")
    def _require_fields_of_kind(self) -> Self:
        if problems := list(self._problems()):
            raise ValueError("\n".join(problems))
        return self

    def _problems(self) -> Iterator[str]:
        kind, rules, given = self.kind, self.rules, self.model_fields_set
        for name in rules.needs:
            if name not in given:
                yield f"{name}: expected a value for {kind}, found none"
        for name in type(self).model_fields:
            if name in given and name not in (*_OF_ALL, *rules.needs, *rules.may, *rules.targets):
                yield f"{name}: expected none for {kind}, found {getattr(self, name)}"
        if rules.targets and len(found := [n for n in rules.targets if n in given]) != 1:
            listed = " and ".join(found) or "none"
            wanted = " or ".join(rules.targets)
            yield f"{rules.targets[0]}: expected {wanted} for {kind}, found {listed}"
        if len(self.ticks) < rules.least_ticks:
            yield (
                f"duration_s: expected at least {rules.least_ticks} control periods of "
                f"{PERIOD_MS:g} ms for {kind}, found {len(self.ticks)} between start_s and its end"
            )
        if rules.is_positive and self.value is not None and self.value <= 0.0:
            yield f"value: expected more than 0 for {kind}, found {self.value:g}"
        if kind == JITTER and self.value is not None and self.value > PERIOD_MS / 2.0:
            yield f"value: expected at most half a control period in ms, found {self.value:g}"

    @property
    def rules(self) -> Kind:
        """What this kind needs and does."""
        return KINDS[self.kind]

    @cached_property
    def ticks(self) -> range:
        """Ticks t of the drive with start_s <= t * PERIOD_S < start_s + duration_s.

        Those of a fault that starts at 0 are one later: 1 is the first tick after the car was first
        driven.
        """
        end_s = self.start_s + (self.duration_s or LONGEST_S)
        first, end = (ceil(round(s / PERIOD_S, 6)) for s in (self.start_s, end_s))
        late = max(1 - first, 0)
        return range(first + late, end + late)

    @cached_property
    def delay_ticks(self) -> int:
        """Control periods of `delay_s`."""
        return round(self.delay_s / PERIOD_S)

    @cached_property
    def frames(self) -> tuple[str, ...]:
        """Names of the DBC, of `messages`; all for a kind that has no target."""
        names = self.messages if self.rules.targets else ("all",)
        return tuple(dict.fromkeys(frame for name in names for frame in MESSAGES[name]))

    @cached_property
    def targets(self) -> tuple[SignalName, ...]:
        """Signals that a kind that changes values acts on: the named ones, or all of `messages`."""
        if self.rules.change is None:
            return ()
        named = tuple(SIGNALS[name] for name in self.signals)
        return named or tuple(entry for frame in self.frames for entry in signals_of(frame))

    @property
    def text(self) -> str:
        """Kind, what it acts on, and when, for people."""
        names = list(map(".".join, self.targets)) or list(self.frames)
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        end = "on" if self.duration_s is None else f"for {self.duration_s:g} s"
        of = f" of {', '.join(names[:MOST_NAMED])}{more}" if names else ""
        return f"{self.kind}{of} from {self.start_s:g} s {end}"

    def acts(self, tick: int) -> bool:
        """True if it acts in a tick of the drive; 0 is before the first one."""
        return tick in self.ticks or (self.before_drive and tick == 0)


Faults = Annotated[tuple[Fault, ...], entries(0, MOST_FAULTS)]


class FaultFile(FileTable):
    """A file of faults, without a scenario."""

    faults: Annotated[tuple[Fault, ...], entries(1, MOST_FAULTS)]


def late_faults(faults: Sequence[Fault], duration_s: float) -> Iterator[str]:
    """A line for each fault that begins after the end of the drive."""
    for k, fault in enumerate(faults):
        start_s = fault.ticks.start * PERIOD_S
        if start_s >= duration_s:
            yield (
                f"faults[{k}].start_s: expected less than duration_s, {duration_s:g} s, found "
                f"{start_s:g}. Let it start earlier."
            )
