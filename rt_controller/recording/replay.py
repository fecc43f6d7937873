"""Replay of a recorded drive: the same controller, fed with the recorded frames in lockstep.

Every call of the recorded loop is made again in its order, with the recorded times in place of the
clock. What the controller computes depends on nothing else, so an unchanged program commands the
same bits.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import can

from rt_controller.bus.log.recorder import RECEIVED, SENT
from rt_controller.bus.messages import COMMAND
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.mapping.can_log import read_frames
from rt_controller.node import ControlNode, build_node, build_planner
from rt_controller.recording.journal import BUS_FAILURE, Call, Header, TickRecord, read_journal
from rt_controller.safety.tick import Tick

_COMMAND_ID = COMMAND.codecs[0].arbitration_id
FRAME = "ACT_CMD"
_COPY_AGAIN = (
    "Copy it again together with its journal; a file that was cut off or damaged cannot be "
    "replayed."
)


@dataclass(frozen=True, slots=True)
class RecordedDrive:
    """Header and ticks of a log and its journal."""

    path: Path
    header: Header
    ticks: tuple[TickRecord, ...]
    """the last one may have the number -1: calls after the last tick"""

    @property
    def driven(self) -> list[TickRecord]:
        """The ticks, without the calls after the last one."""
        return [tick for tick in self.ticks if tick.tick >= 0]

    @property
    def ends_in_drive(self) -> bool:
        """True if the journal ends before the car was released or got the last safe command."""
        last = self.ticks[-1:]
        is_ended = any(call.name == "send_safe_command" for tick in last for call in tick.calls)
        return not is_ended and any(tick.mode is not Mode.STANDBY for tick in self.driven[-1:])

    @property
    def incomplete_from(self) -> int | None:
        """Number of the first tick before whose end something was dropped; None: nothing was."""
        for expected, tick in enumerate(self.ticks):
            if tick.dropped or tick.tick not in (expected, -1):
                return max(tick.tick, 0)
        return None


def read_recorded_drive(path: Path) -> RecordedDrive:
    """The drive that was recorded to this log.

    Raises:
        ConfigError, DatasetError: the log or its journal cannot be read or is damaged, or they do
            not belong together.
    """
    header, ticks = read_journal(path)
    frames = (each.frame for each in read_frames(path, _COPY_AGAIN))

    def with_frames(call: Call) -> Call:
        found = tuple(islice(frames, call.n_frames))
        if len(found) < call.n_frames:
            raise ConfigError(
                f"{path}: expected at least the frames that its journal counts, found fewer: one "
                f"of the two was cut off or edited. Copy both again."
            )
        return call._replace(frames=found)

    joined = (replace(tick, calls=tuple(map(with_frames, tick.calls))) for tick in ticks)
    return RecordedDrive(path, header, tuple(joined))


class ReplayedTick(NamedTuple):
    """One tick of the recorded drive, and what the controller does with its frames now."""

    recorded: TickRecord
    result: Tick
    sent: tuple[can.Message, ...]


class Difference(NamedTuple):
    """A recorded value that the controller does not compute again."""

    tick: int
    signal: str
    recorded: float | str | None
    replayed: float | str | None


class Replay:
    """The controller that the header of a recorded drive describes, before its first tick."""

    def __init__(self, drive: RecordedDrive, model: str | Path | None = None) -> None:
        """Load the model of the drive, or another one if `model` names it.

        Raises:
            ArtifactError: the model cannot be used.
            ConfigError: this version has other settings, or the model has changed since.
        """
        header = drive.header
        self.config = header.controller_config()
        bundle = header.load_model(model)
        self.planner = build_planner(bundle, self.config, max_iterations=header.max_iterations)
        self._drive = drive
        self._clock = _RecordedClock()
        self._bus = _RecordedBus()
        self.node: ControlNode = build_node(
            self._bus, self.config, bundle, self.planner, self._clock
        )

    def ticks(self) -> Iterator[ReplayedTick]:
        """Each recorded tick, replayed; the calls after the last one are a tick of number -1."""
        for tick in self._drive.ticks:
            yield self._replay(tick)

    def close(self) -> None:
        """Shut down the bus of the replay."""
        self._bus.shutdown()

    def _replay(self, tick: TickRecord) -> ReplayedTick:
        step = self.node.step
        self._bus.sent.clear()
        for call in tick.calls:
            if call.name == RECEIVED:
                self._clock.time_ns = call.stamp_ns
                self._bus.waiting.extend(call.frames)
                self.node.inbox.drain(self._bus, call.stamp_ns, len(call.frames))
            elif call.name == BUS_FAILURE:
                self._bus.fails = True
            elif call.name != SENT:
                getattr(step, call.name)()
        if tick.tick >= 0:
            self._clock.time_ns = tick.began_ns
            step.run(tick.skipped, tick.missed_last)
        return ReplayedTick(tick, step.last, tuple(self._bus.sent))


def differences(tick: ReplayedTick) -> list[Difference]:
    """Where the command of a replayed tick differs from the recorded one; empty if nowhere.

    The commands are compared as they were computed, before they were rounded into their frame, and
    then the frame.
    """
    then, now = tick.recorded, tick.result
    pairs: dict[str, tuple[Any, Any]] = {}
    if then.control is not None:
        values = zip(then.control, now.control, strict=True)
        pairs = dict(zip(ControlInput._fields, values, strict=True))
        pairs["mode"] = then.mode.name, now.mode.name
        pairs["cause"] = then.cause.name, now.cause.name
    recorded = _commands(then.frames(SENT))
    if recorded:  # else the interface did not take it
        pairs[FRAME] = recorded[-1], next(iter(_commands(tick.sent)[-1:]), None)
    return [
        Difference(then.tick, name, *pair) for name, pair in pairs.items() if pair[0] != pair[1]
    ]


def _commands(frames: Iterable[can.Message]) -> list[str]:
    return [
        bytes(frame.data).hex().upper() for frame in frames if frame.arbitration_id == _COMMAND_ID
    ]


class _RecordedClock:
    """The recorded time."""

    time_ns = 0

    def now_ns(self) -> int:
        return self.time_ns


class _RecordedBus(can.BusABC):
    """Gives the recorded frames; keeps what is sent."""

    def __init__(self) -> None:
        super().__init__(channel="recorded")
        self.waiting: deque[can.Message] = deque()
        self.sent: list[can.Message] = []
        self.fails = False

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self.waiting:
            return self.waiting.popleft()
        if self.fails:
            self.fails = False
            raise can.CanOperationError("recorded failure of the bus")
        return None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        data = bytes(msg.data)
        self.sent.append(can.Message(arbitration_id=msg.arbitration_id, data=data))

    def shutdown(self) -> None:
        """Nothing is open."""
        can.BusABC.shutdown(self)
