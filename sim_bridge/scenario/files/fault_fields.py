"""`[[faults]]` of a scenario or of a file of faults."""

from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from rt_controller.contract.names import hint
from rt_controller.contract.timing import PERIOD_MS, PERIOD_S
from sim_bridge.scenario.fault_targets import (
    ACTUATOR,
    SignalName,
    frames_of,
    signal_named,
    signals_of,
)
from sim_bridge.scenario.faults import (
    COUNTER_NEXT,
    LEAST_TICKS,
    SHORTHANDS,
    SIGNAL_KINDS,
    Fault,
    FaultKind,
    Shorthand,
    ticks_between,
)
from sim_bridge.scenario.files.fields import FileTable, Number, at_most, not_empty
from sim_bridge.scenario.limits import LONGEST_DELAY_S, LONGEST_S

MOST_FAULTS = 100
KINDS = (*FaultKind, *SHORTHANDS)
_TO_THE_END_S = 2.0 * LONGEST_S
_VALUE_KINDS = frozenset(SIGNAL_KINDS) - {FaultKind.LAG, FaultKind.FREEZE, FaultKind.STUCK}
_DELAY_KINDS = frozenset({FaultKind.DELAY, FaultKind.LAG, FaultKind.REPLAY, FaultKind.BURST})
_OPTIONAL = {
    "probability": frozenset(
        {FaultKind.DROP, FaultKind.DUPLICATE, FaultKind.CORRUPT, FaultKind.REPLAY}
    ),
    "count": frozenset({FaultKind.DUPLICATE, FaultKind.CORRUPT, FaultKind.MASQUERADE}),
    "values": frozenset({FaultKind.MASQUERADE}),
    "period_s": frozenset({FaultKind.MASQUERADE}),
    "counter": frozenset({FaultKind.MASQUERADE}),
    "replaces": frozenset({FaultKind.MASQUERADE, FaultKind.REPLAY}),
    "frame_id": frozenset({FaultKind.MASQUERADE}),
    "data": frozenset({FaultKind.MASQUERADE}),
}
"""kinds that a field may belong to; others refuse it"""


def _known_kind(name: str) -> str:
    if name not in KINDS:
        raise ValueError(f"expected one of {', '.join(KINDS)}, found {name!r}{hint(name, KINDS)}")
    return name


def _known_frames(name: str) -> str:
    frames_of(name)
    return name


def _known_signal(name: str) -> str:
    signal_named(name)
    return name


def _hexadecimal(text: str) -> str:
    try:
        n_bytes = len(bytes.fromhex(text))
    except ValueError:
        n_bytes = -1
    if not 0 <= n_bytes <= 64:
        raise ValueError(f"expected at most 64 hexadecimal bytes, found {text!r}")
    return text


_Kind = Annotated[str, AfterValidator(_known_kind)]
_Frames = Annotated[str, AfterValidator(_known_frames)]
_Signal = Annotated[str, AfterValidator(_known_signal)]
_Delay = Annotated[Number, Field(ge=PERIOD_S, le=LONGEST_DELAY_S)]


class FaultFields(FileTable):
    """One fault."""

    kind: _Kind
    start_s: Annotated[Number, Field(ge=0.0, le=LONGEST_S)] = 0.0
    duration_s: Annotated[Number, Field(gt=0.0, le=LONGEST_S)] | None = None
    """None: to the end of the drive"""
    before_drive: bool = False
    """also while the car waits for a controller"""
    messages: Annotated[tuple[_Frames, ...], AfterValidator(not_empty)] | None = None
    signals: Annotated[tuple[_Signal, ...], AfterValidator(not_empty)] | None = None
    signal: _Signal | None = None
    """the same as `signals` with one entry"""
    value: Number | None = None
    delay_s: _Delay | None = None
    seed: Annotated[int, Field(ge=0, strict=True)] = 0
    probability: Annotated[Number, Field(gt=0.0, le=1.0)] | None = None
    count: Annotated[int, Field(ge=1, le=1000, strict=True)] | None = None
    values: dict[_Signal, Number] | None = None
    period_s: Annotated[Number, Field(ge=PERIOD_S, le=LONGEST_S)] | None = None
    counter: Literal["next", "own", "same"] | None = None
    replaces: bool | None = None
    frame_id: Annotated[int, Field(ge=0, le=0x1FFF_FFFF, strict=True)] | None = None
    data: Annotated[str, AfterValidator(_hexadecimal)] | None = None

    @model_validator(mode="after")
    def _require_fields_of_kind(self) -> Self:
        kind = self._shorthand.kind
        problems = [
            f"{name}: expected {'a value' if wanted else 'none'} for {self.kind}, found "
            f"{found if found is not None else 'none'}"
            for name, wanted, found in self._wanted()
            if wanted is not None and wanted != (found is not None)
        ]
        least = max(LEAST_TICKS.get(kind, 1), self._shorthand.least_ticks)
        n_ticks = len(self._ticks)
        if n_ticks < least:
            problems.append(
                f"duration_s: expected at least {least} control periods of {PERIOD_MS:g} ms for "
                f"{self.kind}, found {n_ticks} between start_s and its end"
            )
        is_positive = self.value is None or self.value > 0.0
        if kind in (FaultKind.QUANTISE, FaultKind.RATE) and not is_positive:
            problems.append(f"value: expected more than 0 for {kind}, found {self.value:g}")
        strangers = [each.signal for each in self._signals if each.frame != ACTUATOR]
        if kind is FaultKind.STUCK and strangers:
            problems.append(f"signals: expected actuators for stuck, found {', '.join(strangers)}")
        if problems:
            raise ValueError("\n".join(problems))
        return self

    def _wanted(self) -> list[tuple[str, bool | None, Any]]:
        """Each field with whether its kind needs it; None: it may be given or not."""
        short, kind = self._shorthand, self._shorthand.kind
        has_target = bool(short.messages or short.signals)
        changes = kind in SIGNAL_KINDS
        named = self.signals or (None if self.signal is None else (self.signal,))
        needs_messages = self._needs_messages(has_target, changes, named is not None)
        return [
            ("messages", needs_messages, self.messages),
            ("signal", changes and not has_target and not needs_messages, named),
            (
                "value",
                None if kind is FaultKind.STUCK else kind in _VALUE_KINDS and short.value is None,
                self.value,
            ),
            ("delay_s", kind in _DELAY_KINDS, self.delay_s),
            *(
                (name, None if kind in kinds else False, getattr(self, name))
                for name, kinds in _OPTIONAL.items()
            ),
        ]

    def _needs_messages(self, has_target: bool, changes: bool, has_signals: bool) -> bool:
        kind = self._shorthand.kind
        if has_target or self.kind in SHORTHANDS or self.frame_id is not None:
            return False
        if kind in (FaultKind.BUS_OFF, FaultKind.STUCK):
            return False
        return not (changes and has_signals)

    @property
    def _shorthand(self) -> Shorthand:
        return SHORTHANDS.get(self.kind) or Shorthand(FaultKind(self.kind))

    @property
    def _ticks(self) -> range:
        return ticks_between(self.start_s, self.duration_s or _TO_THE_END_S)

    @property
    def _window(self) -> str:
        if self.duration_s is None:
            return f"from {self.start_s:g} s on"
        return f"from {self.start_s:g} s for {self.duration_s:g} s"

    @property
    def _frames(self) -> tuple[str, ...]:
        if self._shorthand.kind is FaultKind.BUS_OFF:
            return frames_of("all")
        names = self.messages or self._shorthand.messages
        return tuple(dict.fromkeys(frame for name in names for frame in frames_of(name)))

    @property
    def _signals(self) -> tuple[SignalName, ...]:
        """Those that are named, or all of the named messages."""
        one = () if self.signal is None else (self.signal,)
        names = (*one, *(self.signals or ()), *self._shorthand.signals)
        if names:
            return tuple(signal_named(name) for name in names)
        return tuple(SignalName(frame, s) for frame in self._frames for s in signals_of(frame))

    @property
    def fault(self) -> Fault:
        """The fault."""
        short = self._shorthand
        changes = short.kind in SIGNAL_KINDS
        raw = None
        if self.frame_id is not None:
            raw = self.frame_id, bytes.fromhex(self.data or "")
        contents = tuple((signal_named(name), v) for name, v in (self.values or {}).items())
        return Fault(
            kind=short.kind,
            ticks=self._ticks,
            frames=() if changes else self._frames,
            signals=self._signals if changes else (),
            value=short.value if self.value is None else self.value,
            delay_ticks=round((self.delay_s or 0.0) / PERIOD_S),
            seed=self.seed,
            probability=1.0 if self.probability is None else self.probability,
            times=1 if self.count is None else self.count,
            contents=contents,
            period_ticks=max(round((self.period_s or PERIOD_S) / PERIOD_S), 1),
            counter=self.counter or COUNTER_NEXT,
            replaces=bool(self.replaces),
            raw_frame=raw,
            acts_before_drive=self.before_drive,
            name=self.kind,
            window=self._window,
        )


class FaultFile(FileTable):
    """A file of faults, without a scenario."""

    faults: Annotated[tuple[FaultFields, ...], at_most(MOST_FAULTS), AfterValidator(not_empty)]
