"""The kinds of faults: which fields each has, and what it does to values or to frames.

A kind is one entry of `KINDS`; `docs/faults.md` describes it, `docs/safety.md` lists how controller
and vehicle react.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rt_controller.contract.timing import PERIOD_S
from sim_bridge.faults.names import known_frames

if TYPE_CHECKING:  # a scenario can be checked without python-can
    from can import Message

    from sim_bridge.faults.fault import Fault


class Sample(NamedTuple):
    """One value of a frame, or of the actuators, in a period in which a fault acts."""

    value: float
    """as earlier faults left it"""
    amount: float
    """`value` of the fault; without one the value at its beginning"""
    held: float
    """at the beginning of the fault"""
    late: float
    """of `delay_s` before, without any fault"""
    last: float
    """that was left in the period before"""
    periods: int
    """since the beginning, this one included"""
    rng: np.random.Generator


class FrameFault:
    """A fault of whole frames in one direction: what arrives in place of those that it affects."""

    def __init__(self, fault: "Fault", stream: int) -> None:
        """`stream` separates the random numbers of faults and directions."""
        self.fault = fault
        self.ids = frozenset(known_frames()[name].number for name in fault.frames)
        self.rng = np.random.default_rng((fault.seed, stream))

    def passed(self, frame: "Message", tick: int) -> list["Message"]:
        """What arrives now in place of a frame that was sent in this tick."""
        if frame.arbitration_id not in self.ids or not self.fault.acts(tick):
            return [frame]
        if self.fault.probability < 1.0 and self.rng.random() >= self.fault.probability:
            return [frame]
        return self.affected(frame)

    def affected(self, frame: "Message") -> list["Message"]:
        """What arrives in place of a frame that is affected; here it is lost."""
        return []

    def released(self, tick: int) -> list["Message"]:
        """What was held back and arrives at the beginning of this tick."""
        return []


class _Corrupt(FrameFault):
    def affected(self, frame: "Message") -> list["Message"]:
        n_bits = 8 * len(frame.data)
        for bit in self.rng.choice(n_bits, min(self.fault.count, n_bits), replace=False).tolist():
            frame.data[bit // 8] ^= 1 << bit % 8
        return [frame]


class _Duplicate(FrameFault):
    def affected(self, frame: "Message") -> list["Message"]:
        return [frame] * (1 + self.fault.count)


class _Replay(FrameFault):
    """Keeps what was sent, also before the fault."""

    def __init__(self, fault: "Fault", stream: int) -> None:
        super().__init__(fault, stream)
        self._sent = {n: deque["Message"](maxlen=fault.delay_ticks + 1) for n in self.ids}

    def passed(self, frame: "Message", tick: int) -> list["Message"]:
        if frame.arbitration_id in self.ids:
            self._sent[frame.arbitration_id].append(frame)
        return super().passed(frame, tick)

    def affected(self, frame: "Message") -> list["Message"]:
        sent = self._sent[frame.arbitration_id]
        old = [sent[0]] if len(sent) > self.fault.delay_ticks else []
        return old if self.fault.replaces else [frame, *old]


class _Reorder(FrameFault):
    def __init__(self, fault: "Fault", stream: int) -> None:
        super().__init__(fault, stream)
        self._held: dict[int, Message] = {}

    def affected(self, frame: "Message") -> list["Message"]:
        held = self._held.pop(frame.arbitration_id, None)
        if held is not None:
            return [frame, held]
        self._held[frame.arbitration_id] = frame
        return []

    def released(self, tick: int) -> list["Message"]:
        held = [] if self.fault.acts(tick) else list(self._held.values())
        if held:
            self._held.clear()
        return held


class _Delay(FrameFault):
    """Holds frames back; at the end of the fault all that are held arrive at once."""

    def __init__(self, fault: "Fault", stream: int) -> None:
        super().__init__(fault, stream)
        self._held: deque[tuple[int, Message]] = deque()
        self._calls = 0

    def affected(self, frame: "Message") -> list["Message"]:
        period = self.fault.delay_ticks
        since = self._calls % period if self.fault.base == "burst" else 0
        self._held.append((self._calls - since + period, frame))
        return []

    def released(self, tick: int) -> list["Message"]:
        self._calls += 1  # also while the car waits, and the tick stays 0
        is_over = not self.fault.acts(tick)
        found = []
        while self._held and (is_over or self._held[0][0] <= self._calls):
            found.append(self._held.popleft()[1])
        return found


@dataclass(frozen=True, slots=True)
class Kind:
    """What a fault of this kind needs and does: it changes values, or frames, or adds frames."""

    needs: tuple[str, ...] = ()
    """fields beside the target"""
    may: tuple[str, ...] = ()
    """fields that may be left out; those of no other kind are refused"""
    change: Callable[[Sample], float] | None = None
    frames: type[FrameFault] | None = None
    least_ticks: int = 1
    """shortest fault that has an effect"""
    is_positive: bool = False
    """`value` is larger than 0"""


_VALUE, _DELAY, _SHARE = ("value",), ("delay_s",), ("probability",)


def _limited(s: Sample) -> float:
    change = s.amount * PERIOD_S
    return min(max(s.value, s.last - change), s.last + change)


THIRD_PARTICIPANT = "masquerade"
KINDS = {
    # Values of signals, in frames that are otherwise correct.
    "lag": Kind(_DELAY, change=lambda s: s.late),
    "freeze": Kind(change=lambda s: s.held, least_ticks=2),
    "stuck": Kind(may=_VALUE, change=lambda s: s.amount),
    "scale": Kind(_VALUE, change=lambda s: s.value * s.amount),
    "bias": Kind(_VALUE, change=lambda s: s.value + s.amount),
    "drift": Kind(_VALUE, change=lambda s: s.value + s.amount * PERIOD_S * s.periods),
    "noise": Kind(_VALUE, change=lambda s: s.value + s.amount * float(s.rng.standard_normal())),
    "quantise": Kind(
        _VALUE, change=lambda s: round(s.value / s.amount) * s.amount, is_positive=True
    ),
    "set": Kind(_VALUE, change=lambda s: s.amount),
    "rate": Kind(_VALUE, change=_limited, is_positive=True),
    # Whole frames: whether they arrive, when, how often, and with which bits.
    "corrupt": Kind((), (*_SHARE, "count"), frames=_Corrupt),
    "drop": Kind((), _SHARE, frames=FrameFault),
    "bus_off": Kind(frames=FrameFault),
    "duplicate": Kind((), (*_SHARE, "count"), frames=_Duplicate),
    "replay": Kind(_DELAY, (*_SHARE, "replaces"), frames=_Replay),
    "reorder": Kind(frames=_Reorder, least_ticks=2),
    "delay": Kind(_DELAY, frames=_Delay),
    "burst": Kind(_DELAY, frames=_Delay),
    # Frames of the catalogue, correct in form, from a wrong sender.
    THIRD_PARTICIPANT: Kind(
        may=("count", "values", "period_s", "counter", "replaces", "frame_id", "data")
    ),
}
"""in the order in which they act"""
ORDER = {kind: place for place, kind in enumerate(KINDS)}
