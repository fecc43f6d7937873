"""Faults of signals in a frame: decoded, changed, and encoded again with a valid CRC."""

from collections.abc import Sequence

from rt_controller.bus.catalogue import CATALOGUE
from rt_controller.bus.codec import FrameCodec
from sim_bridge.faults.distortion import Distortion
from sim_bridge.scenario.fault_targets import ACTUATOR, known_frames
from sim_bridge.scenario.fault_targets import VALID as VALID_FLAG
from sim_bridge.scenario.faults import SIGNAL_KINDS, Fault

CODECS = {codec.name: codec for message in CATALOGUE.messages for codec in message.codecs}
"""of all frames, by name"""
CODEC_OF_ID = {codec.arbitration_id: codec for codec in CODECS.values()}


def value_names(frame: str) -> tuple[str, ...]:
    """What `read_values` returns for a frame, or the inputs of the actuators."""
    names = known_frames()[frame]
    return ((names.flag,) if names.flag else ()) + names.signals


def read_values(codec: FrameCodec, data: bytes | bytearray) -> list[float]:
    """The flag beside the counter, and the values; NaN where not available."""
    return [float(codec.flag_of(data)), *codec.decode(data)]


def write_values(codec: FrameCodec, values: Sequence[float], counter: int) -> bytes:
    """The frame with these values, its CRC correct."""
    flag, *rest = values
    if has_valid_flag(codec):
        return codec.write(tuple(rest), counter, is_valid=flag > 0.0)
    flags = min(max(round(flag), 0), codec.protection.largest_flags)
    return codec.write((flags, *rest), counter)


def has_valid_flag(codec: FrameCodec) -> bool:
    """True if the flag of a frame is Valid, False if it is a part of the content."""
    return known_frames()[codec.name].flag == VALID_FLAG


def distortions_of(faults: Sequence[Fault], frame: str) -> list[Distortion]:
    """The faults of the signals of one frame, or of the actuators, in the order of their kinds."""
    names = value_names(frame)
    stream = sorted(known_frames()).index(frame)
    found = []
    for fault in sorted(faults, key=_order):
        places = [names.index(each.signal) for each in fault.signals if each.frame == frame]
        if places:
            found.append(Distortion(fault, places, stream))
    return found


def _order(fault: Fault) -> tuple[int, int]:
    is_of_signals = fault.kind in SIGNAL_KINDS
    return (SIGNAL_KINDS.index(fault.kind) if is_of_signals else 0, fault.delay_ticks)


class FrameChange:
    """All faults of signals of one catalogue, applied frame by frame."""

    def __init__(self, faults: Sequence[Fault]) -> None:
        frames = {each.frame for fault in faults for each in fault.signals} - {ACTUATOR}
        self._distortions = {
            CODECS[name].arbitration_id: distortions_of(faults, name) for name in frames
        }

    def apply(self, arbitration_id: int, data: bytearray, tick: int) -> bytes:
        """The data that is sent in place of `data`."""
        distortions = self._distortions.get(arbitration_id)
        if not distortions:
            return bytes(data)
        codec = CODEC_OF_ID[arbitration_id]
        original = read_values(codec, data)
        values = list(original)
        for each in distortions:
            each.apply(values, original, tick)
        if values == original:
            return bytes(data)
        return write_values(codec, values, codec.counter_of(data))
