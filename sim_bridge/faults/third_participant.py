"""A third participant on the bus: frames of the catalogue, correct in form, from a wrong sender."""

from collections import Counter
from collections.abc import Sequence

from can import Message

from rt_controller.bus.codec import VALID
from rt_controller.bus.message import Node
from sim_bridge.faults.frame_change import CODECS, read_values, value_names, write_values
from sim_bridge.scenario.faults import COUNTER_OWN, COUNTER_SAME, Fault, FaultKind

SMALLEST_EXTENDED_ID = 0x800


class ThirdParticipant:
    """The frames of all faults of the kind masquerade."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        self._faults = [fault for fault in faults if fault.kind is FaultKind.MASQUERADE]
        self._sent: Counter[tuple[int, str]] = Counter()
        self._genuine: dict[int, bytes] = {}

    def observe(self, frame: Message) -> None:
        """Note a genuine frame: other signals and the counter are taken from it."""
        if self._faults:
            self._genuine[frame.arbitration_id] = bytes(frame.data)

    def frames(self, tick: int, sender: Node) -> list[Message]:
        """What it sends in this tick in place of a node, after that node.

        A frame that is not in the DBC is sent after those of the vehicle.
        """
        found = []
        for k, fault in enumerate(self._faults):
            is_due = fault.acts(tick) and (tick - fault.ticks.start) % fault.period_ticks == 0
            names = [name for name in fault.frames if CODECS[name].sender == sender]
            is_raw = fault.raw_frame is not None and sender == Node.VEHICLE
            for _ in range(fault.times if is_due and (names or is_raw) else 0):
                found += self._frames(fault, names, self._sent[k, sender])
                self._sent[k, sender] += 1
        return found

    def _frames(self, fault: Fault, names: list[str], sent: int) -> list[Message]:
        if fault.raw_frame is not None:
            number, data = fault.raw_frame
            return [_frame(number, data, is_fd=len(data) > 8)]
        return [
            _frame(CODECS[name].arbitration_id, self._data(fault, name, sent)) for name in names
        ]

    def _data(self, fault: Fault, name: str, sent: int) -> bytes:
        codec, names = CODECS[name], value_names(name)
        genuine = self._genuine.get(codec.arbitration_id)
        values = [float(VALID), *[0.0] * (len(names) - 1)]
        counter = sent
        if genuine is not None:
            values = read_values(codec, genuine)
            if fault.counter != COUNTER_OWN:
                ahead = 0 if fault.counter == COUNTER_SAME else 1 + sent % max(fault.times, 1)
                counter = codec.counter_of(genuine) + ahead
        for target, value in fault.contents:
            if target.frame == name:
                values[names.index(target.signal)] = value
        return write_values(codec, values, counter)


def _frame(number: int, data: bytes, is_fd: bool = False) -> Message:
    return Message(
        arbitration_id=number,
        is_extended_id=number >= SMALLEST_EXTENDED_ID,
        data=data,
        is_fd=is_fd,
        is_rx=False,
    )
