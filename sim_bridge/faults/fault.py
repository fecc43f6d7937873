"""A fault: what is wrong on the bus or at an actuator, when and for how long, as in a file."""

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from math import ceil
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import AfterValidator, Field, model_validator

from rt_controller.contract.names import hint
from rt_controller.contract.timing import LONGEST_S, MISSION_PERIOD_TICKS, PERIOD_MS, PERIOD_S
from sim_bridge.faults.kinds import KINDS, Kind
from sim_bridge.faults.names import ACTUATOR, SignalName, frames_of, known_frames, signal_named
from sim_bridge.toml_file import FileTable, Number, at_most, not_empty

MOST_FAULTS = 100
MOST_NAMED = 3
"""frames or signals in the text of a fault"""
LONGEST_DELAY_S = 1.0
_OF_ALL = frozenset({"kind", "start_s", "duration_s", "before_drive", "seed"})


class Shorthand(NamedTuple):
    """A kind with its frames or signals; without them it needs one `signal`."""

    kind: str
    messages: tuple[str, ...] = ()
    signals: tuple[str, ...] = ()
    value: float | None = None
    least_ticks: int = 1


_VALID_FLAGS = ("STATE_A.Valid", "STATE_B.Valid", "STATE_C.Valid")
SHORTHANDS = {
    "state_lost": Shorthand("drop", ("state",)),
    "state_invalid": Shorthand("set", signals=_VALID_FLAGS, value=0.0),
    "state_frozen": Shorthand("freeze", ("STATE_A", "STATE_B")),
    "state_delayed": Shorthand("lag", ("state",)),
    "state_offset": Shorthand("bias"),
    "state_noise": Shorthand("noise"),
    "reference_lost": Shorthand("drop", ("reference",)),
    "preview_lost": Shorthand("drop", ("preview",)),
    "mission_lost": Shorthand("drop", ("MISSION",), least_ticks=MISSION_PERIOD_TICKS),
    "command_lost": Shorthand("drop", ("ACT_CMD",)),
}


def _known_kind(name: str) -> str:
    known = (*KINDS, *SHORTHANDS)
    if name not in known:
        raise ValueError(f"expected one of {', '.join(known)}, found {name!r}{hint(name, known)}")
    return name


def _hexadecimal(text: str) -> str:
    try:
        is_short = len(bytes.fromhex(text)) <= 64
    except ValueError:
        is_short = False
    if not is_short:
        raise ValueError(f"expected at most 64 hexadecimal bytes, found {text!r}")
    return text


def _if_found(find: Callable[[str], object]) -> AfterValidator:
    """Keep a name that `find` knows."""

    def check(name: str) -> str:
        find(name)
        return name

    return AfterValidator(check)


def ticks_between(start_s: float, duration_s: float) -> range:
    """The ticks t with start_s <= t * PERIOD_S < start_s + duration_s.

    Those of a fault that starts at 0 are one later: in tick 0 no car is driven yet.
    """
    first, end = (ceil(round(s / PERIOD_S, 6)) for s in (start_s, start_s + duration_s))
    late = max(1 - first, 0)
    return range(first + late, end + late)


_Signal = Annotated[str, _if_found(signal_named)]
_Frames = Annotated[str, _if_found(frames_of)]


class Fault(FileTable):
    """One fault; `docs/faults.md` describes the fields."""

    kind: Annotated[str, AfterValidator(_known_kind)]
    """of `KINDS` or of `SHORTHANDS`"""
    start_s: Annotated[Number, Field(ge=0.0, le=LONGEST_S)] = 0.0
    duration_s: Annotated[Number, Field(gt=0.0, le=LONGEST_S)] | None = None
    """None: to the end of the drive"""
    before_drive: bool = False
    """also while the car waits for a controller"""
    messages: Annotated[tuple[_Frames, ...], AfterValidator(not_empty)] = ()
    signals: Annotated[tuple[_Signal, ...], AfterValidator(not_empty)] = ()
    signal: _Signal | None = None
    """the same as `signals` with one entry"""
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
    data: Annotated[str, AfterValidator(_hexadecimal)] = ""
    """with `frame_id`: a third participant's frame that is not in the DBC"""

    @model_validator(mode="after")
    def _require_fields_of_kind(self) -> Self:
        problems = list(self._problems())
        if problems:
            raise ValueError("\n".join(problems))
        return self

    def _problems(self) -> Iterator[str]:
        rules, needed = self.rules, self._needed
        given = {"signal" if name == "signals" else name for name in self.model_fields_set}
        for name in type(self).model_fields:
            slot = "signal" if name == "signals" else name
            if slot == name and name in needed and name not in given:
                yield f"{name}: expected a value for {self.kind}, found none"
            elif name in self.model_fields_set and slot not in {*needed, *rules.may, *_OF_ALL}:
                yield f"{name}: expected none for {self.kind}, found {getattr(self, name)}"
        least, n_ticks = max(rules.least_ticks, self._shorthand.least_ticks), len(self.ticks)
        if n_ticks < least:
            yield (
                f"duration_s: expected at least {least} control periods of {PERIOD_MS:g} ms for "
                f"{self.kind}, found {n_ticks} between start_s and its end"
            )
        if rules.is_positive and self.value is not None and self.value <= 0.0:
            yield f"value: expected more than 0 for {self.base}, found {self.value:g}"
        strangers = [each.signal for each in self.targets if each.frame != ACTUATOR]
        if self.base == "stuck" and strangers:
            yield f"signals: expected actuators for stuck, found {', '.join(strangers)}"

    @property
    def _needed(self) -> set[str]:
        """Fields that a fault of this kind needs beside those of all."""
        short, changes = self._shorthand, self.rules.change is not None
        needed = {*self.rules.needs} - ({"value"} if short.value is not None else set())
        if short.messages or short.signals or self.base == "bus_off" or self.frame_id is not None:
            return needed
        is_of_signals = self.kind in SHORTHANDS or self.base == "stuck"
        is_of_signals |= changes and not {"signal", "signals"}.isdisjoint(self.model_fields_set)
        return needed | {"signal" if is_of_signals else "messages"}

    @property
    def _shorthand(self) -> Shorthand:
        return SHORTHANDS.get(self.kind) or Shorthand(self.kind)

    @cached_property
    def base(self) -> str:
        """The entry of `KINDS`, also of a short name."""
        return self._shorthand.kind

    @property
    def rules(self) -> Kind:
        """What this kind needs and does."""
        return KINDS[self.base]

    @cached_property
    def ticks(self) -> range:
        """Of the drive: 1 is the first one after the car was first driven."""
        return ticks_between(self.start_s, self.duration_s or LONGEST_S)

    @cached_property
    def delay_ticks(self) -> int:
        """Control periods of `delay_s`."""
        return round(self.delay_s / PERIOD_S)

    @cached_property
    def frames(self) -> tuple[str, ...]:
        """Names of the DBC; empty for a kind that changes values."""
        return () if self.rules.change else self._named_frames

    @property
    def _named_frames(self) -> tuple[str, ...]:
        names = self.messages or self._shorthand.messages
        if self.base == "bus_off":
            names = ("all",)
        return tuple(dict.fromkeys(frame for name in names for frame in frames_of(name)))

    @cached_property
    def targets(self) -> tuple[SignalName, ...]:
        """Signals that a kind that changes values acts on: the named ones, or all of `messages`."""
        if not self.rules.change:
            return ()
        one = () if self.signal is None else (self.signal,)
        if names := (*one, *self.signals, *self._shorthand.signals):
            return tuple(signal_named(name) for name in names)
        frames = known_frames()
        return tuple(SignalName(f, s) for f in self._named_frames for s in frames[f].signals)

    @cached_property
    def amount(self) -> float | None:
        """`value`, or that of the short name."""
        return self._shorthand.value if self.value is None else self.value

    @property
    def text(self) -> str:
        """Kind, what it acts on, and when, for people."""
        names = [".".join(each) for each in self.targets] or list(self.frames)
        if self._shorthand.messages or self._shorthand.signals:
            names = []  # the short name tells
        listed = f"of {', '.join(names[:MOST_NAMED])}" if names else ""
        if len(names) > MOST_NAMED:
            listed = f"{listed} and {len(names) - MOST_NAMED} more"
        end = "on" if self.duration_s is None else f"for {self.duration_s:g} s"
        return " ".join(filter(None, (self.kind, listed, f"from {self.start_s:g} s", end)))

    def acts(self, tick: int) -> bool:
        """True if it acts in a tick of the drive; 0 is before the first one."""
        return tick in self.ticks or (self.before_drive and tick == 0)


Faults = Annotated[tuple[Fault, ...], at_most(MOST_FAULTS)]


class FaultFile(FileTable):
    """A file of faults, without a scenario."""

    faults: Annotated[Faults, AfterValidator(not_empty)]


def late_faults(faults: Sequence[Fault], duration_s: float) -> Iterator[str]:
    """A line for each fault that begins after the end of the drive."""
    for k, fault in enumerate(faults):
        start_s = fault.ticks.start * PERIOD_S
        if start_s >= duration_s:
            yield (
                f"faults[{k}].start_s: expected less than duration_s, {duration_s:g} s, found "
                f"{start_s:g}. Let it start earlier."
            )
