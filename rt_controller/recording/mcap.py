"""Decoded signals, state, plan and cause of every tick as an MCAP file.

Topics: `/can/MESSAGE` for each message of the catalogue, `/state`, `/path`, `/plan`, `/controller`.
The messages are JSON; their schemas have the unit of each number as its description. What is not
available is left out.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cantools.database.namedsignalvalue import NamedSignalValue

from rt_controller.bus.codec import NOT_AVAILABLE
from rt_controller.bus.dbc import dbc_path, read_dbc
from rt_controller.bus.log.log_file import LogFile
from rt_controller.bus.log.recorder import RecordedFrame
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import needs_extra
from rt_controller.contract.faults import Fault
from rt_controller.contract.signals import (
    INPUT_UNITS,
    STATE_UNITS,
    ControlInput,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.recording.journal import DrivenTick

if TYPE_CHECKING:
    from foxglove import Channel
    from foxglove.mcap import MCAPWriter

_CHUNK_BYTES = 1 << 16
"""of uncompressed messages; a killed program loses what it has not written"""
_UNITS = {
    **dict(zip(VehicleState._fields, STATE_UNITS, strict=True)),
    **dict(zip(PathReference._fields, ("m", "1", "1/m", "1/m^2", "m/s", "m/s^2"), strict=True)),
    **dict(zip(ControlInput._fields, INPUT_UNITS, strict=True)),
    "curvature_per_m": "1/m",
    "time_s": "s",
}


class _File:
    """What foxglove-sdk writes to, without seeking.

    Given a path, the package would print a failed write and go on, so that a full disk would be
    found at the end of the drive only. `LogFile` keeps the failure.
    """

    def __init__(self, path: Path, replaces: bool) -> None:
        self.log = LogFile(path, replaces)
        self._size = 0

    def write(self, data: bytes | bytearray) -> int:
        """Number of bytes: all. After a write that failed, nothing more is written."""
        if not self.log.failure:
            self.log.append([bytes(data)])
        self._size += len(data)
        return len(data)

    def seek(self, offset: int, whence: int = 0) -> int:
        """The position, which cannot be changed."""
        return self._size

    def flush(self) -> None:
        """Every write has been passed on already."""


class McapSink:
    """`Sink` for an MCAP file."""

    def __init__(
        self, path: Path, epoch_offset_ns: int = 0, replaces: bool = False, is_fd: bool = False
    ) -> None:
        """Open the file, as `LogFile`; `epoch_offset_ns` is added to every stamp."""
        with needs_extra("record", "MCAP"):
            import foxglove
        from foxglove.mcap import MCAPWriteOptions

        self.failure = ""
        self._epoch_offset_ns = epoch_offset_ns
        self._file = _File(path, replaces)
        self.path = self._file.log.path
        self._context = foxglove.Context()
        self._messages = {each.frame_id: each for each in read_dbc(dbc_path(is_fd)).messages}
        self._channels: dict[str, Channel] = {}
        options = MCAPWriteOptions(chunk_size=_CHUNK_BYTES, disable_seeking=True)
        self._writer: MCAPWriter | None = foxglove.open_mcap(
            self._file, context=self._context, writer_options=options
        )

    def append(self, entries: Sequence[object], n_logged: int) -> None:
        try:
            for entry in entries:
                if isinstance(entry, RecordedFrame):
                    self._add_frame(entry)
                elif isinstance(entry, DrivenTick):
                    self._add_tick(entry)
        except Exception as error:  # of the package, which writes in its own code
            self.failure = str(error)
        if self._file.log.failure:
            self.failure = self._file.log.failure
            self._close_writer()  # it would print every further message as an error

    def close(self) -> None:
        self._close_writer()
        self._file.log.close()
        self.failure = self._file.log.failure or self.failure

    def _close_writer(self) -> None:
        writer, self._writer = self._writer, None
        try:
            if writer is not None:
                writer.close()
        except Exception as error:  # as above
            self.failure = self.failure or str(error)

    def _add_frame(self, frame: RecordedFrame) -> None:
        message = self._messages.get(frame.identifier)
        if message is None or frame.is_extended or frame.is_remote or frame.is_error:
            return
        try:
            decoded = message.decode_simple(frame.data)
        except Exception:  # damaged, or shorter: the log of frames has its bytes
            return
        numbers = {name: _number(value) for name, value in decoded.items()}
        units = {signal.name: signal.unit or "1" for signal in message.signals}
        self._log(f"/can/{message.name}", frame.stamp_ns, numbers, units)

    def _add_tick(self, tick: DrivenTick) -> None:
        record, result, began_ns = tick.record, tick.result, tick.record.began_ns
        if result.state is not None:
            state = result.state._asdict()
            self._log("/state", began_ns, {**state, "curvature_per_m": result.curvature_per_m})
        if result.path is not None:
            self._log("/path", began_ns, result.path._asdict())
        content = {
            "tick": record.tick,
            "mode": result.mode.name,
            "mode_number": int(result.mode),
            "cause": result.cause.name,
            "why": result.cause.value,
            "faults": [fault.name for fault in Fault(result.faults)],
            **result.control._asdict(),
            "sent_after_us": record.sent_after_us,
            "late_cause": record.late_cause,
            "skipped_ticks": record.skipped,
            "log_frames_dropped": record.dropped,
            **record.times,
        }
        self._log("/controller", began_ns, content)
        if tick.plan is not None:
            self._log("/plan", began_ns, _plan(*tick.plan))

    def _log(
        self,
        topic: str,
        stamp_ns: int,
        content: Mapping[str, Any],
        units: Mapping[str, str] = _UNITS,
    ) -> None:
        from foxglove import Channel

        channel = self._channels.get(topic)
        if channel is None:
            properties = {name: _schema(name, value, units) for name, value in content.items()}
            title = topic.rsplit("/", maxsplit=1)[-1]
            schema = {"title": title, "type": "object", "properties": properties}
            channel = Channel(topic, schema=schema, context=self._context)
            self._channels[topic] = channel
        available = {name: value for name, value in content.items() if value is not None}
        channel.log(available, log_time=stamp_ns + self._epoch_offset_ns)


def _plan(inputs: Array, states: Array) -> dict[str, Any]:
    columns = {"time_s": [PERIOD_S * stage for stage in range(len(states))]}
    for names, values in ((VehicleState._fields, states), (ControlInput._fields, inputs)):
        columns |= dict(zip(names, values.T.tolist(), strict=True))
    return columns


def _number(value: object) -> float | None:
    """The value as a number; None if it is not available."""
    if isinstance(value, NamedSignalValue):
        return None if value.name == NOT_AVAILABLE else float(value.value)
    return float(value)  # type: ignore[arg-type]


def _schema(name: str, value: object, units: Mapping[str, str]) -> dict[str, Any]:
    found: dict[str, Any]
    if isinstance(value, list):
        found = {"type": "array", "items": {"type": "string" if name == "faults" else "number"}}
    else:
        found = {"type": "string" if isinstance(value, str) or name == "late_cause" else "number"}
    unit = units.get(name) or ("us" if name.endswith("_us") else None)
    return {**found, "description": unit} if unit else found
