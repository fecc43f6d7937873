"""The kinds of faults: which fields each has, and what it does to values or to frames.

A kind is one entry of `KINDS`; `docs/faults.md` describes it, `docs/safety.md` lists how controller
and vehicle react.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rt_controller.contract.timing import PERIOD_S


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
