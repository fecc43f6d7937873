"""The seam at which faults act: the vehicle's end of a bus, and its actuators."""

from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from copy import copy

import can
import numpy as np

from rt_controller.bus.log.recorder import Recorder
from rt_controller.bus.messages import Node
from rt_controller.contract.signals import ControlInput
from sim_bridge.faults.effects import (
    CODECS,
    Distortion,
    FrameFault,
    ThirdParticipant,
    read_values,
    write_values,
)
from sim_bridge.faults.fault import FRAME_KINDS, JITTER, ORDER, THIRD_PARTICIPANT, Fault
from sim_bridge.faults.names import ACTUATOR

_CODEC_OF_ID = {codec.arbitration_id: codec for codec in CODECS.values()}


class FaultyBus:
    """A layer between the vehicle and its bus, in both directions; `send` and `recv` as a bus.

    A fault between sender and receiver acts on the receiver only. Frames of a third participant
    reach both ends, as on a real bus, in each period after the genuine ones. A full or broken bus
    loses the frames that this class adds.
    """

    def __init__(
        self, bus: can.BusABC, faults: Sequence[Fault], recorder: Recorder | None = None
    ) -> None:
        """Join a bus; `recorder` logs the frames of the vehicle as they arrive."""
        self._bus, self._recorder = bus, recorder
        self._tick = self._now_ns = 0
        self._distortions: dict[str, list[Distortion]] = {}
        for fault in sorted(faults, key=lambda fault: (ORDER[fault.kind], fault.delay_ticks)):
            for name in {target.frame for target in fault.targets}:
                self._distortions.setdefault(name, []).append(Distortion(fault, name))
        self._outgoing, self._incoming = _stages(faults, 0), _stages(faults, 1)
        self._third = [ThirdParticipant(f) for f in faults if f.kind == THIRD_PARTICIPANT]
        self._jitters = [(f, np.random.default_rng(f.seed)) for f in faults if f.kind == JITTER]
        self._genuine: dict[int, bytes] = {}  # the last frame of each id
        self._arrived: deque[can.Message] = deque()
        self._foreign: deque[can.Message] = deque()
        self._has_read_all = True

    def begin_reading(self, tick: int) -> None:
        """Before the vehicle reads in a tick of the drive."""
        self._tick = tick
        self._arrived.extend(_released(self._incoming, tick))
        self._has_read_all = False

    def begin_sending(self, tick: int, now_ns: int) -> None:
        """Before the vehicle sends its frames of a tick of the drive, at `now_ns`."""
        self._tick, self._now_ns = tick, now_ns
        for frame in _released(self._outgoing, tick):
            with suppress(Exception):  # each backend raises its own type
                self._send(frame, 0)

    def sample_age_s(self, tick: int) -> float:
        """How long before the end of a period the state is sampled that is sent then."""
        return max(
            (2e-3 * (f.value or 0.0) * rng.random() for f, rng in self._jitters if f.acts(tick)),
            default=0.0,
        )

    def end_sending(self) -> None:
        """After the vehicle has sent its frames."""
        self._add_foreign(Node.VEHICLE)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame of the vehicle, as the faults change it."""
        for arrived in self._through(self._outgoing, msg):
            self._send(arrived, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame for the vehicle; None: none is waiting."""
        while not self._arrived:
            frame = self._bus.recv(timeout)
            if frame is None:
                if not self._has_read_all:
                    self._has_read_all = True
                    self._add_foreign(Node.CONTROLLER)
                return self._foreign.popleft() if self._foreign else None
            self._arrived.extend(self._through(self._incoming, frame))
        return self._arrived.popleft()

    def actuated(self, commanded: ControlInput, tick: int) -> ControlInput:
        """What the actuators do in a tick of the drive; pedals stay within their travel."""
        throttle, brake_n, steer_rad = self._distorted(ACTUATOR, commanded, tick)
        return ControlInput(min(max(throttle, 0.0), 1.0), max(brake_n, 0.0), steer_rad)

    def _distorted(self, frame: str, original: Sequence[float], tick: int) -> list[float]:
        values = list(original)
        for each in self._distortions.get(frame, ()):
            each.apply(values, original, tick)
        return values

    def _through(self, stages: list[FrameFault], frame: can.Message) -> list[can.Message]:
        """What arrives in place of a frame; changed values are sent with a valid CRC."""
        self._genuine[frame.arbitration_id] = bytes(frame.data)
        changed = copy(frame)
        changed.data = bytearray(frame.data)
        codec = _CODEC_OF_ID.get(frame.arbitration_id)
        if codec is not None and codec.name in self._distortions:
            original = read_values(codec, frame.data)
            values = self._distorted(codec.name, original, self._tick)
            if values != original:
                changed.data = bytearray(write_values(codec, values, codec.check(frame.data)))
        return _passed(stages, [changed], self._tick)

    def _add_foreign(self, sender: Node) -> None:
        for each in self._third:
            for frame in each.frames(self._tick, sender, self._genuine):
                self._foreign.append(frame)
                with suppress(Exception):
                    self._bus.send(frame, 0)

    def _send(self, frame: can.Message, timeout: float | None) -> None:
        self._bus.send(frame, timeout)
        if self._recorder is not None:
            self._recorder.record(frame, self._now_ns, is_sent=True)


def _stages(faults: Sequence[Fault], direction: int) -> list[FrameFault]:
    """The faults of whole frames in one direction, in the order in which frames pass them."""
    # A third participant may replace the genuine frames, as if they were dropped.
    drops = [f for f in faults if f.kind == THIRD_PARTICIPANT and f.replaces]
    chosen = [*(f for f in faults if f.kind in FRAME_KINDS), *drops]
    chosen.sort(key=lambda f: ORDER["drop" if f.kind == THIRD_PARTICIPANT else f.kind])
    return [FrameFault(fault, 2 * k + direction) for k, fault in enumerate(chosen)]


def _passed(
    stages: Sequence[FrameFault], frames: list[can.Message], tick: int
) -> list[can.Message]:
    """What arrives now in place of frames that were sent in this tick."""
    for stage in stages:
        frames = [arrived for frame in frames for arrived in stage.passed(frame, tick)]
    return frames


def _released(stages: Sequence[FrameFault], tick: int) -> list[can.Message]:
    """What was held back until this tick; call once per tick, before its frames."""
    found: list[can.Message] = []
    for k, stage in enumerate(stages):
        found += _passed(stages[k + 1 :], stage.released(tick), tick)
    return found
