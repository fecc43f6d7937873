"""The seam at which faults act: the vehicle's end of a bus, and its actuators."""

from collections import Counter, deque
from collections.abc import Sequence
from contextlib import suppress
from copy import copy
from operator import itemgetter

import can
import numpy as np

from rt_controller.bus.catalogue import CATALOGUE
from rt_controller.bus.codec import VALID as IS_VALID
from rt_controller.bus.codec import FrameCodec
from rt_controller.bus.log.recorder import Recorder
from rt_controller.bus.message import Node
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.faults.fault import Fault
from sim_bridge.faults.kinds import ORDER, THIRD_PARTICIPANT, FrameFault, Sample
from sim_bridge.faults.names import ACTUATOR, VALID, known_frames, signal_named

CODECS = {codec.name: codec for message in CATALOGUE.messages for codec in message.codecs}
"""of all frames, by name"""
_CODEC_OF_ID = {codec.arbitration_id: codec for codec in CODECS.values()}
SMALLEST_EXTENDED_ID = 0x800


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
        self._bus = bus
        self._recorder = recorder
        self._tick = 0
        self._now_ns = 0
        frames = {target.frame for fault in faults for target in fault.targets}
        self._distortions = {name: _distortions(faults, name) for name in frames}
        self._outgoing, self._incoming = _Line(faults, 0), _Line(faults, 1)
        self._third = _ThirdParticipant(faults)
        self._arrived: deque[can.Message] = deque()
        self._foreign: deque[can.Message] = deque()
        self._has_read_all = True

    def begin_reading(self, tick: int) -> None:
        """Before the vehicle reads in a tick of the drive."""
        self._tick = tick
        self._arrived.extend(self._incoming.released(tick))
        self._has_read_all = False

    def begin_sending(self, tick: int, now_ns: int) -> None:
        """Before the vehicle sends its frames of a tick of the drive, at `now_ns`."""
        self._tick, self._now_ns = tick, now_ns
        for frame in self._outgoing.released(tick):
            with suppress(Exception):  # each backend raises its own type
                self._send(frame, 0)

    def end_sending(self) -> None:
        """After the vehicle has sent its frames."""
        self._add_foreign(Node.VEHICLE)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame of the vehicle, as the faults change it."""
        self._third.observe(msg)
        for arrived in self._outgoing.passed(self._changed(msg), self._tick):
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
            self._third.observe(frame)
            self._arrived.extend(self._incoming.passed(self._changed(frame), self._tick))
        return self._arrived.popleft()

    def actuated(self, commanded: ControlInput, tick: int) -> ControlInput:
        """What the actuators do in a tick of the drive; pedals stay within their travel."""
        if ACTUATOR not in self._distortions:
            return commanded
        values = list(commanded)
        for each in self._distortions[ACTUATOR]:
            each.apply(values, commanded, tick)
        throttle, brake_n, steer_rad = values
        return ControlInput(min(max(throttle, 0.0), 1.0), max(brake_n, 0.0), steer_rad)

    def _changed(self, frame: can.Message) -> can.Message:
        """A copy of the frame with other values and a valid CRC, if a fault changes them."""
        changed = copy(frame)
        changed.data = bytearray(frame.data)
        codec = _CODEC_OF_ID.get(frame.arbitration_id)
        if codec is not None and codec.name in self._distortions:
            original = _read(codec, frame.data)
            values = list(original)
            for each in self._distortions[codec.name]:
                each.apply(values, original, self._tick)
            if values != original:
                changed.data = bytearray(_write(codec, values, codec.counter_of(frame.data)))
        return changed

    def _add_foreign(self, sender: Node) -> None:
        foreign = self._third.frames(self._tick, sender)
        self._foreign.extend(foreign)
        for frame in foreign:
            with suppress(Exception):
                self._bus.send(frame, 0)

    def _send(self, frame: can.Message, timeout: float | None) -> None:
        self._bus.send(frame, timeout)
        if self._recorder is not None:
            self._recorder.record(frame, self._now_ns, is_sent=True)


class _Distortion:
    """Changes some values of a vector in the periods in which its fault acts."""

    def __init__(self, fault: Fault, places: Sequence[int], stream: int) -> None:
        """Distort the values at `places`; `stream` separates the noise of several vectors."""
        self._fault = fault
        self._places = places
        self._rng = np.random.default_rng((fault.seed, stream))
        self._history: deque[tuple[float, ...]] = deque(maxlen=fault.delay_ticks + 1)
        self._held: tuple[float, ...] | None = None
        self._last: tuple[float, ...] | None = None
        """the values that were left last"""

    def apply(self, values: list[float], original: Sequence[float], tick: int) -> None:
        """Change `values` in place, once for each vector that is sent.

        Args:
            values: as earlier faults left them.
            original: the same vector before all faults.
            tick: of the drive.
        """
        self._history.append(tuple(original))
        before = tuple(values)
        self._held = (self._held or before) if self._fault.acts(tick) else None
        if self._held is not None and self._fault.rules.change is not None:
            last, periods = self._last or before, tick - self._fault.ticks.start + 1
            for i in self._places:
                held = self._held[i]
                amount = held if self._fault.amount is None else self._fault.amount
                late = self._history[0][i]
                values[i] = self._fault.rules.change(
                    Sample(values[i], amount, held, late, last[i], periods, self._rng)
                )
        self._last = tuple(values)


def _distortions(faults: Sequence[Fault], frame: str) -> list[_Distortion]:
    """The faults of the signals of one frame, or of the actuators, in the order of their kinds."""
    names = known_frames()[frame].values
    stream = sorted(known_frames()).index(frame)
    placed = (
        (fault, [names.index(each.signal) for each in fault.targets if each.frame == frame])
        for fault in sorted(faults, key=lambda fault: (ORDER[fault.base], fault.delay_ticks))
    )
    return [_Distortion(fault, places, stream) for fault, places in placed if places]


def _read(codec: FrameCodec, data: bytes | bytearray) -> list[float]:
    """The flag beside the counter, and the values; NaN where not available."""
    return [float(codec.flag_of(data)), *codec.decode(data)]


def _write(codec: FrameCodec, values: Sequence[float], counter: int) -> bytes:
    """The frame with these values, its CRC correct; the flag is Valid or a part of the content."""
    flag, *rest = values
    if known_frames()[codec.name].flag == VALID:
        return codec.write(tuple(rest), counter, is_valid=flag > 0.0)
    flags = min(max(round(flag), 0), codec.protection.largest_flags)
    return codec.write((flags, *rest), counter)


class _Line:
    """The way of the frames in one direction, through all faults of whole frames."""

    def __init__(self, faults: Sequence[Fault], direction: int) -> None:
        chosen = [
            (ORDER[fault.base], fault.rules.frames, fault) for fault in faults if fault.rules.frames
        ]
        chosen += [  # a third participant that replaces the genuine frames
            (ORDER["drop"], FrameFault, fault)
            for fault in faults
            if fault.base == THIRD_PARTICIPANT and fault.replaces
        ]
        chosen.sort(key=itemgetter(0))
        self._stages = [
            stage(fault, 2 * k + direction) for k, (_, stage, fault) in enumerate(chosen)
        ]

    def passed(self, frame: can.Message, tick: int) -> list[can.Message]:
        """What arrives now in place of a frame that was sent in this tick."""
        return self._through([frame], 0, tick)

    def released(self, tick: int) -> list[can.Message]:
        """What was held back until this tick; call once per tick, before its frames."""
        found: list[can.Message] = []
        for k, stage in enumerate(self._stages):
            found += self._through(stage.released(tick), k + 1, tick)
        return found

    def _through(self, frames: list[can.Message], first: int, tick: int) -> list[can.Message]:
        for stage in self._stages[first:]:
            frames = [arrived for frame in frames for arrived in stage.passed(frame, tick)]
        return frames


class _ThirdParticipant:
    """Sends frames of the catalogue, correct in form, from a wrong sender."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        self._faults = [fault for fault in faults if fault.base == THIRD_PARTICIPANT]
        self._sent: Counter[tuple[int, str]] = Counter()
        self._genuine: dict[int, bytes] = {}

    def observe(self, frame: can.Message) -> None:
        """Note a genuine frame: other signals and the counter are taken from it."""
        if self._faults:
            self._genuine[frame.arbitration_id] = bytes(frame.data)

    def frames(self, tick: int, sender: Node) -> list[can.Message]:
        """What it sends in this tick in place of a node, after that node.

        A frame that is not in the DBC is sent after those of the vehicle.
        """
        found = []
        for k, fault in enumerate(self._faults):
            period = max(round(fault.period_s / PERIOD_S), 1)
            is_due = fault.acts(tick) and (tick - fault.ticks.start) % period == 0
            names = [name for name in fault.frames if CODECS[name].sender == sender]
            is_raw = fault.frame_id is not None and sender == Node.VEHICLE
            for _ in range(fault.count if is_due and (names or is_raw) else 0):
                if fault.frame_id is not None:
                    found.append(_frame(fault.frame_id, bytes.fromhex(fault.data)))
                sent = self._sent[k, sender]
                found += [
                    _frame(CODECS[name].arbitration_id, self._data(fault, CODECS[name], sent))
                    for name in names
                ]
                self._sent[k, sender] += 1
        return found

    def _data(self, fault: Fault, codec: FrameCodec, sent: int) -> bytes:
        names = known_frames()[codec.name].values
        values, counter = [float(IS_VALID), *[0.0] * (len(names) - 1)], sent
        if genuine := self._genuine.get(codec.arbitration_id):
            values = _read(codec, genuine)
            if fault.counter != "own":
                ahead = 0 if fault.counter == "same" else 1 + sent % fault.count
                counter = codec.counter_of(genuine) + ahead
        for name, value in fault.values.items():
            target = signal_named(name)
            if target.frame == codec.name:
                values[names.index(target.signal)] = value
        return _write(codec, values, counter)


def _frame(number: int, data: bytes) -> can.Message:
    return can.Message(
        arbitration_id=number,
        is_extended_id=number >= SMALLEST_EXTENDED_ID,
        data=data,
        is_fd=len(data) > 8,
        is_rx=False,
    )
