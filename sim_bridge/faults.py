"""Faults of a scenario, applied to what the bridge sends and receives."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from rt_controller.bus.catalogue import StateSample
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.scenario.faults import Fault, FaultKind

_ORDER = (
    FaultKind.STATE_DELAYED,
    FaultKind.STATE_FROZEN,
    FaultKind.STATE_OFFSET,
    FaultKind.STATE_NOISE,
)
"""of faults that change the same sample"""


class FaultInjector:
    """Decides what is sent while faults act; without faults everything passes unchanged.

    Faults that act together change a sample in a fixed order of their kinds; of two delays the
    longer one counts.
    """

    def __init__(self, faults: Sequence[Fault]) -> None:
        self._faults = faults
        self._changes = sorted(
            (fault for fault in faults if fault.kind in _ORDER),
            key=lambda fault: (_ORDER.index(fault.kind), fault.delay_ticks),
        )
        self._rngs = {fault: np.random.default_rng(fault.seed) for fault in faults}
        longest = max((fault.delay_ticks for fault in faults), default=0)
        self._samples: deque[StateSample] = deque(maxlen=longest + 1)
        self._frozen: StateSample | None = None

    def acts(self, kind: FaultKind, tick: int) -> bool:
        """True if a fault of this kind acts in a tick of the drive."""
        return any(fault.kind is kind and tick in fault.ticks for fault in self._faults)

    def acted(self, tick: int) -> tuple[str, ...]:
        """Kind and begin of each fault that has acted by this tick of the drive."""
        return tuple(
            f"{fault.kind} from {fault.ticks.start * PERIOD_S:g} s"
            for fault in self._faults
            if fault.ticks and fault.ticks.start <= tick
        )

    def sample(self, sample: StateSample, tick: int) -> StateSample:
        """The sample that is sent instead of `sample`; call once per period."""
        if not self._faults:
            return sample
        self._samples.append(sample)
        if not self.acts(FaultKind.STATE_FROZEN, tick):
            self._frozen = None
        for fault in self._changes:
            if tick in fault.ticks:
                sample = self._apply(fault, sample)
        return sample

    def _apply(self, fault: Fault, sample: StateSample) -> StateSample:
        if fault.kind is FaultKind.STATE_FROZEN:
            self._frozen = self._frozen or sample
            return sample._replace(state=self._frozen.state)
        if fault.kind is FaultKind.STATE_DELAYED:
            return self._samples[-1 - min(fault.delay_ticks, len(self._samples) - 1)]
        change = fault.value
        if fault.kind is FaultKind.STATE_NOISE:
            change *= float(self._rngs[fault].standard_normal())
        moved = getattr(sample.state, fault.signal) + change
        return sample._replace(state=sample.state._replace(**{fault.signal: moved}))
