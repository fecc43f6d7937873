"""Decoded signals, state, plan and cause of every tick as an MCAP file.

Topics: `/can/MESSAGE` for each message of the catalogue, `/state`, `/path`, `/plan`, `/controller`.
The messages are JSON; their schemas have the unit of each number as its description. What is not
available is left out.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cantools.database.can import Message
from cantools.database.namedsignalvalue import NamedSignalValue

from rt_controller.bus.codec import NOT_AVAILABLE
from rt_controller.bus.dbc import dbc_path, read_dbc
from rt_controller.bus.log.frame_log import RecordedFrame
from rt_controller.bus.log.recorder import Entry
from rt_controller.bus.messages import Fault
from rt_controller.contract.errors import needs_extra
from rt_controller.contract.signals import (
    INPUT_UNITS,
    STATE_UNITS,
    ControlInput,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.recording.journal import PLAN, TICK, JournalEntry, PlannedTrajectory
from rt_controller.recording.mcap_file import McapFile

if TYPE_CHECKING:
    from cantools.typechecking import SignalValueType
    from foxglove import Channel
    from foxglove.mcap import MCAPWriter


class McapSink:
    """`Sink` for an MCAP file."""

    def __init__(
        self, path: Path, epoch_offset_ns: int = 0, replaces: bool = False, is_fd: bool = False
    ) -> None:
        """Open the file.

        Args:
            path: of the MCAP file.
            epoch_offset_ns: added to every stamp, to turn monotonic into calendar time.
            replaces: replace an existing file.
            is_fd: the frames are those of CAN FD.

        Raises:
            ConfigError: the file cannot be written, or exists already.
            MissingExtraError: foxglove-sdk is not installed.
        """
        with needs_extra("record", "MCAP"):
            import foxglove

        self.path = path
        self.failure = ""
        self._epoch_offset_ns = epoch_offset_ns
        self._file = McapFile(path, replaces)
        self._context = foxglove.Context()
        self._messages = {
            message.frame_id: message for message in read_dbc(dbc_path(is_fd)).messages
        }
        self._channels: dict[str, Channel] = {}
        self._writer: MCAPWriter | None = None

    def append(self, entries: Sequence[Entry], n_logged: int) -> None:
        try:
            if self._writer is None and not self.failure:
                self._writer = self._file.writer(self._context)
            for entry in entries:
                self._add(entry)
        except Exception as error:  # of the package, which writes in its own code
            self.failure = str(error)
        if self._file.failure:
            self.failure = self._file.failure
            self._close_writer()  # it would print every further message as an error

    def close(self) -> None:
        self._close_writer()
        self._file.close()
        self.failure = self._file.failure or self.failure

    def _close_writer(self) -> None:
        writer, self._writer = self._writer, None
        try:
            if writer is not None:
                writer.close()
        except Exception as error:  # as above
            self.failure = self.failure or str(error)

    def _add(self, entry: Entry) -> None:
        if isinstance(entry, RecordedFrame):
            message = self._messages.get(entry.identifier)
            if message is not None and not (entry.is_extended or entry.is_remote or entry.is_error):
                self._add_frame(message, entry)
        elif entry.kind == TICK and isinstance(entry.content, JournalEntry):
            self._add_tick(entry.content)
        elif entry.kind == PLAN and isinstance(entry.content, PlannedTrajectory):
            self._add_plan(entry.content)

    def _add_frame(self, message: Message, frame: RecordedFrame) -> None:
        try:
            decoded = message.decode_simple(frame.data)
        except Exception:  # damaged, or shorter: the log of frames has its bytes
            return
        numbers = {name: _number(value) for name, value in decoded.items()}
        units = {signal.name: signal.unit or "1" for signal in message.signals}
        self._log(f"/can/{message.name}", frame.stamp_ns, numbers, units)

    def _add_tick(self, entry: JournalEntry) -> None:
        tick, result, measured = entry.tick, entry.tick.result, entry.tick.measured
        if result.state is not None:
            sample = result.state
            content = {**sample.state._asdict(), "curvature_per_m": sample.curvature_per_m}
            self._log("/state", tick.began_ns, content, _UNITS)
        if result.path is not None:
            self._log("/path", tick.began_ns, result.path._asdict(), _UNITS)
        content = {
            "tick": tick.number,
            "mode": result.mode.name,
            "mode_number": int(result.mode),
            "cause": result.cause.name,
            "why": result.cause.value,
            "faults": [fault.name for fault in Fault(result.faults)],
            **result.control._asdict(),
            "sent_after_us": measured.sent_after_ns / 1e3,
            "late_cause": None if measured.cause is None else measured.cause.value,
            "skipped_ticks": measured.skipped,
            "log_frames_dropped": entry.dropped,
            **measured.times._asdict(),
        }
        self._log("/controller", tick.began_ns, content, _UNITS)

    def _add_plan(self, plan: PlannedTrajectory) -> None:
        stages = len(plan.states)
        content: dict[str, Any] = {"time_s": [PERIOD_S * stage for stage in range(stages)]}
        for fields, values in (
            (VehicleState._fields, plan.states),
            (ControlInput._fields, plan.inputs),
        ):
            content |= dict(zip(fields, values.T.tolist(), strict=True))
        self._log("/plan", plan.stamp_ns, content, _UNITS)

    def _log(
        self, topic: str, stamp_ns: int, content: dict[str, Any], units: Mapping[str, str]
    ) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._open_channel(topic, content, units)
        available = {name: value for name, value in content.items() if value is not None}
        channel.log(available, log_time=stamp_ns + self._epoch_offset_ns)

    def _open_channel(
        self, topic: str, content: Mapping[str, Any], units: Mapping[str, str]
    ) -> "Channel":
        from foxglove import Channel

        properties = {name: _schema(name, value, units) for name, value in content.items()}
        title = topic.rsplit("/", maxsplit=1)[-1]
        schema = {"title": title, "type": "object", "properties": properties}
        return Channel(topic, schema=schema, context=self._context)


_UNITS = {
    **dict(zip(VehicleState._fields, STATE_UNITS, strict=True)),
    **dict(zip(PathReference._fields, ("m", "1", "1/m", "1/m^2", "m/s", "m/s^2"), strict=True)),
    **dict(zip(ControlInput._fields, INPUT_UNITS, strict=True)),
    "curvature_per_m": "1/m",
    "time_s": "s",
}


def _number(value: "SignalValueType") -> float | None:
    """The value as a number; None if it is not available."""
    if isinstance(value, NamedSignalValue):
        return None if value.name == NOT_AVAILABLE else float(value.value)
    return float(value)


def _schema(name: str, value: object, units: Mapping[str, str]) -> dict[str, Any]:
    if isinstance(value, list):
        items = "string" if (value and isinstance(value[0], str)) or name == "faults" else "number"
        found: dict[str, Any] = {"type": "array", "items": {"type": items}}
    else:
        found = {"type": "string" if isinstance(value, str) or name == "late_cause" else "number"}
    unit = units.get(name) or ("us" if name.endswith("_us") else None)
    return {**found, "description": unit} if unit else found
