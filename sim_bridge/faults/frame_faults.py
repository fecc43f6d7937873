"""Faults of whole frames: whether they arrive, when, how often, and with which bits."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from can import Message

from sim_bridge.faults.frame_change import CODECS
from sim_bridge.scenario.faults import FRAME_KINDS, Fault, FaultKind


class Stage(Protocol):
    """One fault on the way of the frames in one direction."""

    def passed(self, frame: Message, tick: int) -> list[Message]:
        """What arrives now in place of a frame that was sent in this tick."""
        ...

    def released(self, tick: int) -> list[Message]:
        """What was held back and arrives at the beginning of this tick."""
        ...


class _Affecting(ABC):
    """Chooses the frames that a fault affects; passes all others."""

    def __init__(self, fault: Fault, stream: int) -> None:
        self.fault = fault
        self.ids = frozenset(CODECS[name].arbitration_id for name in fault.frames)
        self.rng = np.random.default_rng((fault.seed, stream))

    def passed(self, frame: Message, tick: int) -> list[Message]:
        if frame.arbitration_id not in self.ids or not self.is_due(tick):
            return [frame]
        if self.fault.probability < 1.0 and self.rng.random() >= self.fault.probability:
            return [frame]
        return self.affected(frame, tick)

    def is_due(self, tick: int) -> bool:
        return self.fault.acts(tick)

    @abstractmethod
    def affected(self, frame: Message, tick: int) -> list[Message]:
        """What arrives in place of a frame that the fault affects."""

    def released(self, tick: int) -> list[Message]:
        return []


class _Drop(_Affecting):
    def affected(self, frame: Message, tick: int) -> list[Message]:
        return []


class _Corrupt(_Affecting):
    def affected(self, frame: Message, tick: int) -> list[Message]:
        n_bits = 8 * len(frame.data)
        for bit in self.rng.choice(n_bits, min(self.fault.times, n_bits), replace=False).tolist():
            frame.data[bit // 8] ^= 1 << bit % 8
        return [frame]


class _Duplicate(_Affecting):
    def affected(self, frame: Message, tick: int) -> list[Message]:
        return [frame] * (1 + self.fault.times)


class _Replay(_Affecting):
    """Keeps what was sent, also before the fault; the frame of `delay_ticks` before follows."""

    def __init__(self, fault: Fault, stream: int) -> None:
        super().__init__(fault, stream)
        self._sent: dict[int, deque[tuple[int, Message]]] = {
            number: deque(maxlen=fault.delay_ticks + 1) for number in self.ids
        }

    def passed(self, frame: Message, tick: int) -> list[Message]:
        if frame.arbitration_id in self.ids:
            self._sent[frame.arbitration_id].append((tick, frame))
        return super().passed(frame, tick)

    def affected(self, frame: Message, tick: int) -> list[Message]:
        sent = self._sent[frame.arbitration_id]
        old = [sent[0][1]] if len(sent) > self.fault.delay_ticks else []
        return old if self.fault.replaces else [frame, *old]


class _Reorder(_Affecting):
    """Holds every second frame of an id until the next one has arrived."""

    def __init__(self, fault: Fault, stream: int) -> None:
        super().__init__(fault, stream)
        self._held: dict[int, Message] = {}

    def affected(self, frame: Message, tick: int) -> list[Message]:
        held = self._held.pop(frame.arbitration_id, None)
        if held is not None:
            return [frame, held]
        self._held[frame.arbitration_id] = frame
        return []

    def released(self, tick: int) -> list[Message]:
        if self.fault.acts(tick):
            return []
        held = list(self._held.values())
        self._held.clear()
        return held


class _Delay(_Affecting):
    """Holds frames back; at the end of the fault all that are held arrive at once."""

    def __init__(self, fault: Fault, stream: int) -> None:
        super().__init__(fault, stream)
        self._held: deque[tuple[int, Message]] = deque()
        self._calls = 0

    def affected(self, frame: Message, tick: int) -> list[Message]:
        self._held.append((self._calls + self.fault.delay_ticks, frame))
        return []

    def released(self, tick: int) -> list[Message]:
        self._calls += 1  # also while the car waits, and the tick stays 0
        is_over = not self.fault.acts(tick)
        found = []
        while self._held and (is_over or self._held[0][0] <= self._calls):
            found.append(self._held.popleft()[1])
        return found


class _Burst(_Delay):
    def affected(self, frame: Message, tick: int) -> list[Message]:
        period = self.fault.delay_ticks
        self._held.append((self._calls - self._calls % period + period, frame))
        return []


_STAGES: dict[FaultKind, type[_Affecting]] = {
    FaultKind.CORRUPT: _Corrupt,
    FaultKind.DROP: _Drop,
    FaultKind.BUS_OFF: _Drop,
    FaultKind.DUPLICATE: _Duplicate,
    FaultKind.REPLAY: _Replay,
    FaultKind.REORDER: _Reorder,
    FaultKind.DELAY: _Delay,
    FaultKind.BURST: _Burst,
}


class FramePath:
    """The way of the frames in one direction, through all faults of whole frames."""

    def __init__(self, faults: Sequence[Fault], direction: int) -> None:
        chosen = [fault for fault in faults if fault.kind in FRAME_KINDS]
        chosen += [  # a third participant that replaces the genuine frames
            fault._replace(kind=FaultKind.DROP, probability=1.0)
            for fault in faults
            if fault.kind is FaultKind.MASQUERADE and fault.replaces
        ]
        chosen.sort(key=lambda fault: FRAME_KINDS.index(fault.kind))
        self._stages: list[Stage] = [
            _STAGES[fault.kind](fault, 2 * k + direction) for k, fault in enumerate(chosen)
        ]

    def passed(self, frame: Message, tick: int) -> list[Message]:
        """What arrives now in place of a frame that was sent in this tick."""
        return self._through([frame], 0, tick)

    def released(self, tick: int) -> list[Message]:
        """What was held back until this tick; call once per tick, before its frames."""
        found: list[Message] = []
        for k, stage in enumerate(self._stages):
            found += self._through(stage.released(tick), k + 1, tick)
        return found

    def _through(self, frames: list[Message], first: int, tick: int) -> list[Message]:
        for stage in self._stages[first:]:
            frames = [arrived for frame in frames for arrived in stage.passed(frame, tick)]
        return frames
