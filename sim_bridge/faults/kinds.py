"""The kinds of faults: which fields each has, and what it does to values or to frames.

A kind is one entry of `KINDS`; `docs/faults.md` describes it, `docs/safety.md` lists how controller
and vehicle react.
"""

from collections import deque
from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rt_controller.contract.timing import PERIOD_S
from sim_bridge.faults.names import FRAMES

if TYPE_CHECKING:  # a scenario can be checked without python-can
    from can import Message

    from sim_bridge.faults.fault import Fault


class Sample(NamedTuple):
    """One value of a frame, or of the actuators, in a period in which a fault acts."""

    value: float  # as earlier faults left it
    amount: float  # `value` of the fault; without one the value at its beginning
    held: float  # at the beginning of the fault
    late: float  # of `delay_s` before, without any fault
    last: float  # that was left in the period before
    periods: int  # since the beginning, this one included
    rng: np.random.Generator


class FrameFault:
    """A fault of whole frames in one direction: what arrives in place of those that it affects."""

    def __init__(self, fault: "Fault", stream: int) -> None:
        """`stream` separates the random numbers of faults and directions."""
        self._fault = fault
        self._rng = np.random.default_rng((fault.seed, stream))
        self._sent = {
            FRAMES[name].number: deque["Message"](maxlen=fault.delay_ticks + 1)
            for name in fault.frames
        }
        """of each id, also before the fault"""
        self._held: deque[tuple[float, Message]] = deque()
        """frames, and the call of `released` in which they arrive"""
        self._calls = 0

    def passed(self, frame: "Message", tick: int) -> list["Message"]:
        """What arrives now in place of a frame that was sent in this tick."""
        sent = self._sent.get(frame.arbitration_id)
        if sent is None:
            return [frame]
        sent.append(frame)
        is_affected = self._fault.acts(tick) and (
            self._fault.probability == 1.0 or self._rng.random() < self._fault.probability
        )
        return self._affected(frame, sent) if is_affected else [frame]

    def _affected(self, frame: "Message", sent: deque["Message"]) -> list["Message"]:
        fault = self._fault
        match fault.kind:
            case "corrupt":
                bits = 8 * len(frame.data)
                for bit in self._rng.choice(bits, min(fault.count, bits), replace=False).tolist():
                    frame.data[bit // 8] ^= 1 << bit % 8
                return [frame]
            case "duplicate":
                return [frame] * (1 + fault.count)
            case "replay":
                old = [sent[0]] if len(sent) > fault.delay_ticks else []
                return old if fault.replaces else [frame, *old]
            case "reorder":
                for entry in self._held:
                    if entry[1].arbitration_id == frame.arbitration_id:
                        self._held.remove(entry)
                        return [frame, entry[1]]
                self._held.append((inf, frame))
            case "delay" | "burst":
                since = self._calls % fault.delay_ticks if fault.kind == "burst" else 0
                self._held.append((self._calls - since + fault.delay_ticks, frame))
        return []

    def released(self, tick: int) -> list["Message"]:
        """What was held back and arrives at the beginning of this tick; all that is, at the end."""
        self._calls += 1  # also while the car waits, and the tick stays 0
        is_over = not self._fault.acts(tick)
        found = []
        while self._held and (is_over or self._held[0][0] <= self._calls):
            found.append(self._held.popleft()[1])
        return found


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
    # Whole frames: whether they arrive, when, how often, and with which bits; see `FrameFault`.
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
