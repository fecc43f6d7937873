"""The journal beside a log of frames: what the loop did between them, one line of JSON per tick.

With it a drive can be replayed: a candump line has neither the instant at which a tick read the
frame, nor the order of reading, preparing and sending. The journal names frames by their order in
the log, so the log stays one that every reader of its format opens. The first line is the header.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, BeforeValidator, NonNegativeInt, PositiveInt, TypeAdapter
from pydantic import ValidationError as Refused

from rt_controller.bus.log.frame_log import RecordedFrame
from rt_controller.bus.log.log_file import LogFile
from rt_controller.bus.log.recorder import Entry
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import open_regular
from rt_controller.contract.settings_errors import dotted, explain
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.loop import FinishedTick
from rt_controller.safety.modes import StopCause

FORMAT = 1
SUFFIX = ".journal"
TICK, CALL, BUS_FAILURE, PLAN = "tick", "call", "bus_failure", "plan"
"""kinds of `LoopEvent`; the contents are a `JournalEntry`, the name of a call, nothing, and a
`PlannedTrajectory`, which only other sinks use"""
RECEIVED, SENT = "received", "sent"
_CallName = Literal[
    "received",
    "sent",
    "bus_failure",
    "update_matrices",
    "warm_up",
    "request_stop",
    "send_safe_command",
]


class JournalEntry(NamedTuple):
    """A finished tick, and the frames that were missing in the log by then."""

    tick: FinishedTick
    dropped: int


class PlannedTrajectory(NamedTuple):
    """A plan at one instant, copied."""

    stamp_ns: int
    inputs: Array
    """(N, 3)"""
    states: Array
    """(N + 1, 6), predicted"""


class Call(NamedTuple):
    """Something that happened before the end of a tick."""

    name: _CallName
    """RECEIVED, SENT, BUS_FAILURE, or a call of the step"""
    stamp_ns: NonNegativeInt = 0
    """of frames"""
    frames: NonNegativeInt = 0
    """that the log has, one after the other"""


def _member(kind: type[Enum], name: object) -> Enum:
    """The member of this name; other names are refused by pydantic, with the field."""
    if name not in kind.__members__:
        raise ValueError(f"expected one of {', '.join(kind.__members__)}")
    return kind[str(name)]


@dataclass(frozen=True, slots=True)
class JournalTick:
    """One line of the journal."""

    number: int
    """counted from zero; -1: calls after the last tick"""
    calls: tuple[Call, ...]
    began_ns: NonNegativeInt = 0
    scheduled_ns: NonNegativeInt = 0
    skipped: NonNegativeInt = 0
    missed_last: bool = False
    mode: Annotated[Mode, BeforeValidator(partial(_member, Mode))] = Mode.STANDBY
    cause: Annotated[StopCause, BeforeValidator(partial(_member, StopCause))] = StopCause.NONE
    control: ControlInput | None = None
    faults: int = 0
    dropped: NonNegativeInt = 0
    sent_after_us: float = 0.0
    times: Mapping[str, float] = field(default_factory=dict)
    """by field of `TickTimes`"""
    late_cause: str | None = None


_TICK = TypeAdapter(JournalTick)
_FIELDS = tuple(JournalTick.__dataclass_fields__)[2:]
"""of a tick, by the same name in its line"""


class _Model(BaseModel):
    name: str
    sha256: str


class _Header(BaseModel):
    """What the first line has at least."""

    version: str
    model: _Model
    config: dict[str, Any]
    max_iterations: PositiveInt | None
    catalogue: str
    is_fd: bool = False
    packages: dict[str, str | None]
    machine: str


def journal_path(log: Path) -> Path:
    """The journal of a log."""
    return log.with_name(log.name + SUFFIX)


class Journal:
    """`Sink` that writes the journal of a log."""

    def __init__(self, log: Path, header: Mapping[str, Any], replaces: bool = False) -> None:
        """Open the journal beside `log`.

        Raises:
            ConfigError: it cannot be written, or exists already and `replaces` is False.
        """
        self._file = LogFile(journal_path(log), replaces)
        self._lines = [_line({"journal_format": FORMAT, **header})]
        """not yet written"""
        self._calls: list[list[str | int]] = []

    @property
    def path(self) -> Path:
        return self._file.path

    @property
    def failure(self) -> str:
        return self._file.failure

    def append(self, entries: Sequence[Entry], n_logged: int) -> None:
        for entry in entries:
            if isinstance(entry, RecordedFrame):
                n_logged -= 1
                if n_logged >= 0 and is_replayed(entry.is_remote, entry.is_error):
                    self._add_frame(entry)
            elif entry.kind == TICK and isinstance(entry.content, JournalEntry):
                self._lines.append(_line({**_tick_to_json(entry.content), "calls": self._calls}))
                self._calls = []
            elif entry.kind in (CALL, BUS_FAILURE):
                name = entry.content if entry.kind == CALL else BUS_FAILURE
                self._calls.append([str(name)])
        self._file.append(self._lines)
        self._lines = []

    def close(self) -> None:
        if self._calls:
            self._file.append([_line({"tick": -1, "calls": self._calls})])
        self._file.close()

    def _add_frame(self, frame: RecordedFrame) -> None:
        name = SENT if frame.is_sent else RECEIVED
        last = self._calls[-1] if self._calls else []
        if last[:2] == [name, frame.stamp_ns]:
            last[2] = int(last[2]) + 1
        else:
            self._calls.append([name, frame.stamp_ns, 1])


def is_replayed(is_remote: bool, is_error: bool) -> bool:
    """True for frames with data; the step uses no others, and some formats reorder those."""
    return not (is_remote or is_error)


def read_journal(log: Path) -> tuple[dict[str, Any], list[JournalTick]]:
    """Header and ticks of the journal beside `log`.

    Raises:
        ConfigError: there is none, or it is not one.
    """
    path = journal_path(log)
    if log.suffix.lower() in (".mcap", ".mf4"):
        raise ConfigError(
            f"{log}: expected a log of frames (.log, .blf, .asc), found the suffix {log.suffix}. "
            f"Name the log that --record wrote in the same drive."
        )
    number = 1
    try:
        with open_regular(path) as file:
            header = _object(file.readline())
            if _require(header, "journal_format") != FORMAT:
                raise ConfigError(
                    f"{path}: expected a journal of format {FORMAT}, found "
                    f"{header['journal_format']}. Replay it with the version that recorded it "
                    f"({header.get('version')})."
                )
            _Header.model_validate(header)
            ticks = []
            for line in file:
                number += 1
                ticks.append(_tick_from_json(_object(line)))
        return header, ticks
    except Refused as error:
        raise ConfigError(
            f"{path}, line {number}: expected the journal of a log, found a line that was edited "
            f"or damaged:\n{explain(error, dotted)}\nCopy it again."
        ) from error
    except FileNotFoundError:
        raise ConfigError(
            f"{log}: expected its journal {path.name} in the same folder, found none. It says what "
            f"each tick had read: rt-controller --record writes both; keep them together. A log "
            f"of another program has none, and cannot be replayed."
        ) from None
    except OSError as error:
        raise ConfigError(
            f"{path}: expected a journal that can be read, found {error.strerror}. Correct its "
            f"permissions."
        ) from error
    except _DamagedLineError as error:
        raise ConfigError(
            f"{path}, line {number}: expected the journal of a log, one line of JSON a tick, found "
            f"{error}. Copy it again; a journal that was cut off may end after any line."
        ) from error


class _DamagedLineError(Exception):
    """What was found in place of a line."""


def _object(line: str | bytes) -> dict[str, Any]:
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise _DamagedLineError("another text" if line.strip() else "an empty line")
    return content


def _require(line: Mapping[str, Any], name: str) -> Any:
    if name not in line:
        raise _DamagedLineError(f"no field {name!r}")
    return line[name]


def _line(content: Mapping[str, Any]) -> bytes:
    return json.dumps(content, separators=(",", ":"), default=str).encode() + b"\n"


def _tick_to_json(entry: JournalEntry) -> dict[str, Any]:
    tick, measured = entry.tick, entry.tick.measured
    return {
        "tick": tick.number,
        "began_ns": tick.began_ns,
        "scheduled_ns": measured.scheduled_ns,
        "skipped": measured.skipped,
        "missed_last": tick.missed_last,
        "mode": tick.result.mode.name,
        "cause": tick.result.cause.name,
        "control": list(tick.result.control),
        "faults": int(tick.result.faults),
        "dropped": entry.dropped,
        "sent_after_us": measured.sent_after_ns / 1e3,
        "late_cause": None if measured.cause is None else measured.cause.value,
        "times": {name: round(value, 1) for name, value in measured.times._asdict().items()},
    }


def _tick_from_json(line: Mapping[str, Any]) -> JournalTick:
    number, calls = _require(line, "tick"), _require(line, "calls")
    names = () if number == -1 else _FIELDS
    fields = {name: _require(line, name) for name in names}
    return _TICK.validate_python({"number": number, "calls": calls, **fields})
