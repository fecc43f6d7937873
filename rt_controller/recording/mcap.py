"""Decoded signals, state, plan and cause of every replayed tick as an MCAP file.

Topics: `/can/MESSAGE` for each message of the catalogue, `/state`, `/path`, `/plan`, `/controller`.
The messages are JSON; their schemas have the unit of each number as its description. What is not
available is left out.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import can
from cantools.database.namedsignalvalue import NamedSignalValue

from rt_controller.bus.codec import NOT_AVAILABLE
from rt_controller.bus.dbc import read_dbc
from rt_controller.bus.log.log_file import LogFile
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import needs_extra
from rt_controller.contract.faults import Fault
from rt_controller.contract.signals import VEHICLE, ControlInput, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.planner import Planner
from rt_controller.recording.journal import TickRecord
from rt_controller.recording.replay import ReplayedTick
from rt_controller.safety.tick import Tick

if TYPE_CHECKING:
    from foxglove import Channel

_UNITS = {
    **VEHICLE.units,
    **dict(zip(PathReference._fields, ("m", "1", "1/m", "1/m^2", "m/s", "m/s^2"), strict=True)),
    "time_s": "s",
    "lateral_error_m": "m",
}


class _File:
    """What foxglove-sdk writes to, without seeking.

    Given a path, the package would only print a failed write. `LogFile` keeps the failure.
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


class McapFile:
    """An MCAP file of a replayed drive; the stamps are those of the clock of its loop."""

    def __init__(self, path: Path, replaces: bool = False) -> None:
        """Open the file, as `LogFile`."""
        with needs_extra("record", "MCAP"):
            import foxglove
        from foxglove.mcap import MCAPWriteOptions

        self._file = _File(path, replaces)
        self._context = foxglove.Context()
        self._messages = {each.frame_id: each for each in read_dbc().messages}
        self._channels: dict[str, Channel] = {}
        options = MCAPWriteOptions(disable_seeking=True)
        self._writer = foxglove.open_mcap(self._file, context=self._context, writer_options=options)

    @property
    def failure(self) -> str:
        """Why something is missing, for people; empty if nothing is."""
        return self._file.log.failure

    def add(self, tick: ReplayedTick, planner: Planner) -> None:
        """A tick, the frames before it, and the plan that `planner` has just made."""
        for call in tick.recorded.calls:
            for frame in call.frames:
                self._add_frame(call.stamp_ns, frame)
        if tick.recorded.tick >= 0:
            self._add_tick(tick.recorded, tick.result)
            if (states := planner.predicted_states()) is not None:
                self._log("/plan", tick.recorded.began_ns, _plan(planner.inputs, states))

    def close(self) -> None:
        """Complete the file."""
        self._writer.close()
        self._file.log.close()

    def _add_frame(self, stamp_ns: int, frame: can.Message) -> None:
        message = self._messages.get(frame.arbitration_id)
        if message is None or frame.is_extended_id or frame.is_remote_frame or frame.is_error_frame:
            return
        try:
            decoded = message.decode_simple(bytes(frame.data))
        except Exception:  # damaged, or shorter: the log of frames has its bytes
            return
        numbers = {name: _number(value) for name, value in decoded.items()}
        units = {signal.name: signal.unit or "1" for signal in message.signals}
        self._log(f"/can/{message.name}", stamp_ns, numbers, units)

    def _add_tick(self, record: TickRecord, result: Tick) -> None:
        began_ns, lateral_error_m = record.began_ns, None
        if result.state is not None and result.path is not None:
            lateral_error_m = result.state.ey_m - result.path.c0_m
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
            "lateral_error_m": lateral_error_m,
            "sent_after_us": record.sent_after_us,
            "late_cause": record.late_cause,
            "skipped_ticks": record.skipped,
            "log_frames_dropped": record.dropped,
            **record.times,
        }
        self._log("/controller", began_ns, content)

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
        channel.log(available, log_time=stamp_ns)


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
