"""What faults do to values of a frame or of the actuators, to whole frames, and beside them."""

from collections import Counter, deque
from collections.abc import Sequence
from math import inf

import numpy as np
from can import Message

from rt_controller.bus.codec import LARGEST_FLAGS, FrameCodec
from rt_controller.bus.codec import VALID as IS_VALID
from rt_controller.bus.messages import CATALOGUE, Node
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.faults.fault import Fault, Sample
from sim_bridge.faults.names import FRAMES, SIGNALS, VALID

CODECS = {codec.name: codec for message in CATALOGUE.messages for codec in message.codecs}
LARGEST_STANDARD_ID = 0x7FF


class Distortion:
    """Changes some values of a vector in the periods in which its fault acts."""

    def __init__(self, fault: Fault, frame: str) -> None:
        """Distort the values of one frame, or of the actuators."""
        names, self._fault = FRAMES[frame].values, fault
        self._places = [names.index(t.signal) for t in fault.targets if t.frame == frame]
        self._rng = np.random.default_rng((fault.seed, sorted(FRAMES).index(frame)))
        self._history: deque[tuple[float, ...]] = deque(maxlen=fault.delay_ticks + 1)
        self._held: tuple[float, ...] | None = None
        self._last: tuple[float, ...] | None = None  # the values that were left last

    def apply(self, values: list[float], original: Sequence[float], tick: int) -> None:
        """Change `values`, as earlier faults left them, in place; once for each vector sent."""
        fault, before = self._fault, tuple(values)
        self._history.append(tuple(original))
        self._held = (self._held or before) if fault.acts(tick) else None
        if self._held is not None and fault.rules.change is not None:
            late, last = self._history[0], self._last or before
            periods = tick - fault.ticks.start + 1
            for i in self._places:
                held = self._held[i]
                amount = held if fault.value is None else fault.value
                now = Sample(values[i], amount, held, late[i], last[i], periods, self._rng)
                values[i] = fault.rules.change(now)
        self._last = tuple(values)


class FrameFault:
    """A fault of whole frames in one direction: what arrives in place of those that it affects."""

    def __init__(self, fault: Fault, stream: int) -> None:
        """`stream` separates the random numbers of faults and directions."""
        self._fault = fault
        self._rng = np.random.default_rng((fault.seed, stream))
        self._sent = {
            FRAMES[name].number: deque[Message](maxlen=fault.delay_ticks + 1)
            for name in fault.frames
        }
        """of each id, also before the fault"""
        self._held: deque[tuple[float, Message]] = deque()
        """frames, and the call of `released` in which they arrive"""
        self._calls = 0

    def passed(self, frame: Message, tick: int) -> list[Message]:
        """What arrives now in place of a frame that was sent in this tick."""
        sent = self._sent.get(frame.arbitration_id)
        if sent is None:
            return [frame]
        sent.append(frame)
        is_affected = self._fault.acts(tick) and (
            self._fault.probability == 1.0 or self._rng.random() < self._fault.probability
        )
        return self._affected(frame, sent) if is_affected else [frame]

    def _affected(self, frame: Message, sent: deque[Message]) -> list[Message]:
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

    def released(self, tick: int) -> list[Message]:
        """What was held back and arrives at the beginning of this tick; all that is, at the end."""
        self._calls += 1  # also while the car waits, and the tick stays 0
        is_over = not self._fault.acts(tick)
        found = []
        while self._held and (is_over or self._held[0][0] <= self._calls):
            found.append(self._held.popleft()[1])
        return found


class ThirdParticipant:
    """Sends frames of the catalogue, correct in form, from a wrong sender."""

    def __init__(self, fault: Fault) -> None:
        self._fault = fault
        self._sent: Counter[str] = Counter()

    def frames(self, tick: int, sender: Node, genuine: dict[int, bytes]) -> list[Message]:
        """What it sends in this tick in place of a node, after that node.

        Other signals and the counter are taken from the last genuine frame of the same id. A frame
        that is not in the DBC is sent after those of the vehicle.
        """
        fault = self._fault
        period = max(round(fault.period_s / PERIOD_S), 1)
        if not fault.acts(tick) or (tick - fault.ticks.start) % period != 0:
            return []
        found = []
        codecs = [CODECS[name] for name in fault.frames if CODECS[name].sender == sender]
        for _ in range(fault.count):
            if fault.frame_id is not None and sender == Node.VEHICLE:
                found.append(_frame(fault.frame_id, fault.data))
            for codec in codecs:
                data = self._data(codec, genuine.get(codec.arbitration_id), self._sent[sender])
                found.append(_frame(codec.arbitration_id, data))
            self._sent[sender] += 1
        return found

    def _data(self, codec: FrameCodec, genuine: bytes | None, sent: int) -> bytes:
        fault, names = self._fault, FRAMES[codec.name].values
        values, counter = [float(IS_VALID), *[0.0] * (len(names) - 1)], sent
        if genuine is not None:
            values = read_values(codec, genuine)
            if fault.counter != "own":
                ahead = 0 if fault.counter == "same" else 1 + sent % fault.count
                counter = codec.check(genuine) + ahead
        for target, value in ((SIGNALS[name], value) for name, value in fault.values.items()):
            if target.frame == codec.name:
                values[names.index(target.signal)] = value
        return write_values(codec, values, counter)


def _frame(number: int, data: bytes) -> Message:
    kind = {"is_extended_id": number > LARGEST_STANDARD_ID, "is_fd": len(data) > 8}
    return Message(arbitration_id=number, data=data, is_rx=False, **kind)


def read_values(codec: FrameCodec, data: bytes | bytearray) -> list[float]:
    """The flag beside the counter, and the values; NaN where not available."""
    return [float(codec.flag_of(data)), *codec.decode(data)]


def write_values(codec: FrameCodec, values: Sequence[float], counter: int) -> bytes:
    """The frame with these values, its CRC correct; the flag is Valid or a part of the content."""
    flag, *rest = values
    if FRAMES[codec.name].values[0] == VALID:
        return codec.write(tuple(rest), counter, is_valid=flag > 0.0)
    return codec.write((min(max(round(flag), 0), LARGEST_FLAGS), *rest), counter)
