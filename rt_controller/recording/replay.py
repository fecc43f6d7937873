"""Replay of a recorded drive: the same controller, fed with the recorded frames in lockstep.

Every call of the recorded loop is made again in its order, with the recorded times in place of the
clock. What the controller computes depends on nothing else, so an unchanged program commands the
same bits.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import can

from rt_controller.bus.messages import COMMAND
from rt_controller.config import ControllerConfig
from rt_controller.contract.signals import ControlInput
from rt_controller.control.mpc import Mpc
from rt_controller.model.bundle import Bundle
from rt_controller.node import ControlNode, build_node
from rt_controller.recording.journal import BUS_FAILURE, RECEIVED, SENT
from rt_controller.recording.recorded_drive import RecordedDrive, RecordedTick
from rt_controller.step import ControlStep, StepResult

_CALLS = {
    "update_matrices": ControlStep.update_matrices,
    "warm_up": ControlStep.warm_up,
    "request_stop": ControlStep.request_stop,
    "send_safe_command": ControlStep.send_safe_command,
}
_COMMAND_ID = COMMAND.codecs[0].arbitration_id
FRAME = "ACT_CMD"


class ReplayedTick(NamedTuple):
    """One tick of the recorded drive, and what the controller does with its frames now."""

    recorded: RecordedTick
    result: StepResult
    sent: tuple[can.Message, ...]


class Difference(NamedTuple):
    """A recorded value that the controller does not compute again."""

    tick: int
    signal: str
    recorded: float | str | None
    replayed: float | str | None


class Replay:
    """The controller of a recorded drive, before its first tick.

    Raises:
        ArtifactError: the model's encoder cannot be used.
    """

    def __init__(
        self, drive: RecordedDrive, config: ControllerConfig, bundle: Bundle, mpc: Mpc
    ) -> None:
        self.mpc = mpc
        self._drive = drive
        self._clock = _RecordedClock()
        self._bus = _RecordedBus()
        self.node: ControlNode = build_node(
            self._bus, config, bundle, mpc, self._clock, is_fd=drive.is_fd
        )

    def ticks(self) -> Iterator[ReplayedTick]:
        """Each recorded tick, replayed; the calls after the last one are a tick of number -1."""
        for tick in self._drive.ticks:
            yield self._replay(tick)

    def close(self) -> None:
        """Shut down the bus of the replay."""
        self._bus.shutdown()

    def _replay(self, tick: RecordedTick) -> ReplayedTick:
        step, journal = self.node.step, tick.journal
        self._bus.sent.clear()
        for call, frames in tick.calls:
            if call.name == RECEIVED:
                self._clock.set(call.stamp_ns)
                self._bus.waiting.extend(frames)
                self.node.inbox.drain(self._bus, call.stamp_ns, len(frames))
            elif call.name == BUS_FAILURE:
                self._bus.fails = True
            elif call.name != SENT:
                _CALLS[call.name](step)
        if journal.number >= 0:
            self._clock.set(journal.began_ns)
            step.run(journal.skipped, journal.missed_last)
        return ReplayedTick(tick, step.result, tuple(self._bus.sent))


def differences(tick: ReplayedTick) -> list[Difference]:
    """Where the command of a replayed tick differs from the recorded one; empty if nowhere.

    The commands are compared as they were computed, before they were rounded into their frame, and
    then the frame.
    """
    journal = tick.recorded.journal
    pairs: dict[str, tuple[Any, Any]] = {}
    if journal.control is not None:
        pairs = dict(
            zip(
                ControlInput._fields,
                zip(journal.control, tick.result.control, strict=True),
                strict=True,
            )
        )
        pairs["mode"] = journal.mode.name, tick.result.mode.name
        pairs["cause"] = journal.cause.name, tick.result.cause.name
    recorded = _commands(tick.recorded.frames(SENT))
    if recorded:  # else the interface did not take it
        pairs[FRAME] = recorded[-1], next(iter(_commands(tick.sent)[-1:]), None)
    return [
        Difference(journal.number, name, then, now)
        for name, (then, now) in pairs.items()
        if then != now
    ]


def _commands(frames: Iterable[can.Message]) -> list[str]:
    return [
        bytes(frame.data).hex().upper() for frame in frames if frame.arbitration_id == _COMMAND_ID
    ]


class _RecordedClock:
    """The recorded time."""

    def __init__(self) -> None:
        self._now_ns = 0

    def set(self, now_ns: int) -> None:
        self._now_ns = now_ns

    def now_ns(self) -> int:
        return self._now_ns


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
        self.sent.append(can.Message(arbitration_id=msg.arbitration_id, data=data, is_fd=msg.is_fd))

    def shutdown(self) -> None:
        """Nothing is open."""
        can.BusABC.shutdown(self)
