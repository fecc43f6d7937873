"""One fault of signals: it changes values of one frame, or of the actuators."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from rt_controller.contract.timing import PERIOD_S
from sim_bridge.scenario.faults import Fault, FaultKind


class Distortion:
    """Changes some values of a vector in the periods in which its fault acts."""

    def __init__(self, fault: Fault, places: Sequence[int], stream: int) -> None:
        """Distort the values at `places`; `stream` separates the noise of several vectors."""
        self._fault = fault
        self._places = tuple(places)
        self._rng = np.random.default_rng((fault.seed, stream))
        self._history: deque[tuple[float, ...]] = deque(maxlen=fault.delay_ticks + 1)
        self._held: tuple[float, ...] | None = None
        self._last: tuple[float, ...] = ()
        """the values that were left last"""

    def apply(self, values: list[float], original: Sequence[float], tick: int) -> None:
        """Change `values` in place, once for each vector that is sent.

        Args:
            values: as earlier faults left them.
            original: the same vector before all faults.
            tick: of the drive.
        """
        self._history.append(tuple(original))
        if not self._fault.acts(tick):
            self._held = None
            self._last = tuple(values)
            return
        if self._held is None:
            self._held = tuple(values)
        for i in self._places:
            values[i] = self._changed(values[i], i, tick)
        self._last = tuple(values)

    def _changed(self, value: float, i: int, tick: int) -> float:
        held = value if self._held is None else self._held[i]
        amount = held if self._fault.value is None else self._fault.value
        match self._fault.kind:
            case FaultKind.LAG:
                changed = self._history[0][i]
            case FaultKind.FREEZE:
                changed = held
            case FaultKind.SCALE:
                changed = value * amount
            case FaultKind.BIAS:
                changed = value + amount
            case FaultKind.DRIFT:
                changed = value + amount * PERIOD_S * (tick - self._fault.ticks.start + 1)
            case FaultKind.NOISE:
                changed = value + amount * float(self._rng.standard_normal())
            case FaultKind.QUANTISE:
                changed = round(value / amount) * amount
            case FaultKind.RATE:
                last, change = self._last[i] if self._last else value, amount * PERIOD_S
                changed = min(max(value, last - change), last + change)
            case _:  # SET, and STUCK at a value or where it was
                changed = amount
        return changed
