"""Faults as data: what is wrong on the bus or at an actuator, when, and for how long.

`docs/faults.md` describes the kinds. `sim_bridge.faults` applies them; `docs/safety.md` lists how
the controller and the vehicle react.
"""

from enum import StrEnum
from math import ceil
from typing import NamedTuple

from rt_controller.contract.timing import MISSION_PERIOD_TICKS, PERIOD_S
from sim_bridge.scenario.fault_targets import SignalName


class FaultKind(StrEnum):
    """What is wrong."""

    DROP = "drop"
    """frames are lost"""
    DELAY = "delay"
    """frames arrive `delay_s` late"""
    DUPLICATE = "duplicate"
    """frames arrive more than once"""
    REORDER = "reorder"
    """two frames in a row arrive in the wrong order"""
    REPLAY = "replay"
    """after a frame, the one of `delay_s` before arrives once more"""
    CORRUPT = "corrupt"
    """bits of frames are wrong; the CRC is not corrected"""
    BURST = "burst"
    """frames are held back and arrive together every `delay_s`"""
    BUS_OFF = "bus_off"
    """the vehicle neither sends nor receives"""
    MASQUERADE = "masquerade"
    """a third participant sends frames"""
    FREEZE = "freeze"
    """signals keep the value of the beginning, in frames that are otherwise correct"""
    LAG = "lag"
    """signals have the value of `delay_s` before, in frames that are otherwise correct"""
    SCALE = "scale"
    """signals are multiplied by `value`; -1: wrong sign"""
    BIAS = "bias"
    """`value` is added to signals"""
    DRIFT = "drift"
    """an offset that grows by `value` a second is added to signals"""
    NOISE = "noise"
    """normally distributed noise of the standard deviation `value` is added to signals"""
    QUANTISE = "quantise"
    """signals are rounded to multiples of `value`"""
    SET = "set"
    """signals have the value `value`"""
    RATE = "rate"
    """signals change by at most `value` a second"""
    STUCK = "stuck"
    """actuators keep the position of the beginning, or go to `value`"""


SIGNAL_KINDS = (
    FaultKind.LAG,
    FaultKind.FREEZE,
    FaultKind.STUCK,
    FaultKind.SCALE,
    FaultKind.BIAS,
    FaultKind.DRIFT,
    FaultKind.NOISE,
    FaultKind.QUANTISE,
    FaultKind.SET,
    FaultKind.RATE,
)
"""kinds that change values, in the order in which they act on the same signal"""
FRAME_KINDS = (
    FaultKind.CORRUPT,
    FaultKind.DROP,
    FaultKind.BUS_OFF,
    FaultKind.DUPLICATE,
    FaultKind.REPLAY,
    FaultKind.REORDER,
    FaultKind.DELAY,
    FaultKind.BURST,
)
"""kinds that change whether, when and how a frame arrives, in the order in which they act"""
MOST_NAMED = 3
"""frames or signals in the text of a fault"""
COUNTER_NEXT, COUNTER_OWN, COUNTER_SAME = "next", "own", "same"
"""of the frames of a third participant: the one after the genuine frame's, one that it counts by
itself, or that of the genuine frame"""


class Fault(NamedTuple):
    """One fault."""

    kind: FaultKind
    ticks: range
    """of the drive: 1 is the first one after the car was first driven"""
    frames: tuple[str, ...] = ()
    """names of the DBC; of kinds that act on whole frames"""
    signals: tuple[SignalName, ...] = ()
    """of kinds that change values"""
    value: float | None = None
    """in the unit of the signal in the DBC; of actuators in SI"""
    delay_ticks: int = 0
    seed: int = 0
    probability: float = 1.0
    """of each frame to be affected"""
    times: int = 1
    """how many frames are added, or how many bits are wrong"""
    contents: tuple[tuple[SignalName, float], ...] = ()
    """of a third participant's frames; other signals are those of the last genuine frame"""
    period_ticks: int = 1
    """between the frames of a third participant"""
    counter: str = COUNTER_NEXT
    replaces: bool = False
    """True: the genuine frames are lost"""
    raw_frame: tuple[int, bytes] | None = None
    """id and data of a third participant's frame that is not in the DBC"""
    acts_before_drive: bool = False
    """True: also while the car waits for a controller"""
    name: str = ""
    """as written in the file"""
    window: str = ""
    """from when on and for how long, as written in the file"""

    @property
    def text(self) -> str:
        """Kind, what it acts on, and when, for people."""
        targets = [f"{each.frame}.{each.signal}" for each in self.signals] or list(self.frames)
        if self.name in SHORTHANDS and SHORTHANDS[self.name].targets:
            targets = []  # the name tells
        listed = ", ".join(targets[:MOST_NAMED])
        if len(targets) > MOST_NAMED:
            listed = f"{listed} and {len(targets) - MOST_NAMED} more"
        window = self.window or f"from {self.ticks.start * PERIOD_S:g} s on"
        return " ".join(
            filter(None, (self.name or self.kind.value, listed and f"of {listed}", window))
        )

    def acts(self, tick: int) -> bool:
        """True if it acts in a tick of the drive; 0 is before the first one."""
        return tick in self.ticks or (self.acts_before_drive and tick == 0)


class Shorthand(NamedTuple):
    """A kind with its frames."""

    kind: FaultKind
    messages: tuple[str, ...] = ()
    signals: tuple[str, ...] = ()
    value: float | None = None
    least_ticks: int = 1

    @property
    def targets(self) -> tuple[str, ...]:
        """Frames or signals that the name stands for."""
        return self.messages or self.signals


_VALID_FLAGS = ("STATE_A.Valid", "STATE_B.Valid", "STATE_C.Valid")
SHORTHANDS = {
    "state_lost": Shorthand(FaultKind.DROP, ("state",)),
    "state_invalid": Shorthand(FaultKind.SET, signals=_VALID_FLAGS, value=0.0),
    "state_frozen": Shorthand(FaultKind.FREEZE, ("STATE_A", "STATE_B")),
    "state_delayed": Shorthand(FaultKind.LAG, ("state",)),
    "state_offset": Shorthand(FaultKind.BIAS),
    "state_noise": Shorthand(FaultKind.NOISE),
    "reference_lost": Shorthand(FaultKind.DROP, ("reference",)),
    "preview_lost": Shorthand(FaultKind.DROP, ("preview",)),
    "mission_lost": Shorthand(FaultKind.DROP, ("MISSION",), least_ticks=MISSION_PERIOD_TICKS),
    "command_lost": Shorthand(FaultKind.DROP, ("ACT_CMD",)),
}
"""short names of faults"""
LEAST_TICKS = {FaultKind.FREEZE: 2, FaultKind.REORDER: 2}
"""shortest faults that have an effect; of the other kinds: one tick"""


def ticks_between(start_s: float, duration_s: float) -> range:
    """The ticks t with start_s <= t * PERIOD_S < start_s + duration_s.

    Those of a fault that starts at 0 are one later: in tick 0 no car is driven yet.
    """
    first, end = (ceil(round(s / PERIOD_S, 6)) for s in (start_s, start_s + duration_s))
    late = max(1 - first, 0)
    return range(first + late, end + late)
