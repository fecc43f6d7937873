"""The two out-trays: what the controller sends, and what the vehicle sends.

Sending never blocks and never raises: a frame that the interface does not take is counted, and
its counter is used up, so that the receiver sees the gap.
"""

from typing import Protocol

import can

from rt_controller.bus import frames
from rt_controller.bus.codec import FRAME_LENGTH, MessageCodec
from rt_controller.bus.frames import Heartbeat, Identity, Mission, RoadSample
from rt_controller.bus.identity import dbc_hash
from rt_controller.bus.recorder import FrameSink
from rt_controller.contract.signals import ControlInput, Mode, PathReference, VehicleState
from rt_controller.contract.timing import COUNTER_MODULUS


class Transmitter(Protocol):
    """What an out-tray needs of a bus."""

    def send(self, msg: can.Message, timeout: float | None = None) -> None: ...


class _Sender:
    """A bus with one prepared message for every id.

    The messages are used again and again: every backend of python-can has copied or serialised
    a message when `send` returns.
    """

    __slots__ = ("_bus", "_messages", "_recorder", "last_failure", "send_failures", "sent")

    def __init__(
        self, bus: Transmitter, codecs: tuple[MessageCodec, ...], recorder: FrameSink | None
    ) -> None:
        self.sent = 0
        self.send_failures = 0
        self.last_failure = ""
        self._bus = bus
        self._recorder = recorder
        self._messages = {
            codec: can.Message(
                arbitration_id=codec.arbitration_id,
                is_extended_id=False,
                is_rx=False,
                data=bytes(FRAME_LENGTH),
                check=True,
            )
            for codec in codecs
        }

    def post(self, codec: MessageCodec, frame: bytes, now_ns: int) -> None:
        message = self._messages[codec]
        message.data[:] = frame
        try:
            self._bus.send(message, timeout=0)
        except Exception as error:  # each backend raises its own kind
            self.send_failures += 1
            self.last_failure = f"{type(error).__name__}: {error}"
            return
        self.sent += 1
        if self._recorder is not None:
            self._recorder.record(message, now_ns)


class ControllerOutbox:
    """The controller's side: ACT_CMD, CTRL_HB, IDENT_CONTROLLER."""

    def __init__(self, bus: Transmitter, recorder: FrameSink | None = None) -> None:
        self._sender = _Sender(
            bus, (frames.ACT_CMD, frames.CTRL_HB, frames.IDENT_CONTROLLER), recorder
        )
        self._commands: list[ControlInput | None] = [None] * COUNTER_MODULUS
        self._last_counter = -1
        self._heartbeat_counter = 0
        self._identity_counter = 0

    @property
    def sent(self) -> int:
        return self._sender.sent

    @property
    def send_failures(self) -> int:
        return self._sender.send_failures

    @property
    def last_failure(self) -> str:
        """Why a frame was not taken, for people; empty as long as all were."""
        return self._sender.last_failure

    def send_command(self, control: ControlInput, mode: Mode, counter: int, now_ns: int) -> None:
        """One ACT_CMD; `counter` is that of the state it answers, modulo 16.

        So the vehicle sees how many periods lie between its state and the answer.
        """
        counter %= COUNTER_MODULUS
        if counter != self._last_counter:  # the vehicle drops a repeated one
            self._commands[counter] = control
        self._last_counter = counter
        frame = frames.encode_command(control, mode, counter)
        self._sender.post(frames.ACT_CMD, frame, now_ns)

    def command_under(self, counter: int) -> ControlInput | None:
        """What a vehicle means that echoes this counter; None if nothing was sent under it."""
        return self._commands[counter % COUNTER_MODULUS]

    def send_heartbeat(self, heartbeat: Heartbeat, now_ns: int) -> None:
        """One CTRL_HB."""
        frame = frames.encode_heartbeat(heartbeat, self._heartbeat_counter)
        self._heartbeat_counter = (self._heartbeat_counter + 1) % COUNTER_MODULUS
        self._sender.post(frames.CTRL_HB, frame, now_ns)

    def send_identity(self, model_hash: int | None, now_ns: int) -> None:
        """One IDENT_CONTROLLER."""
        identity = Identity(dbc_hash(), model_hash)
        frame = frames.encode_controller_identity(identity, self._identity_counter)
        self._identity_counter = (self._identity_counter + 1) % COUNTER_MODULUS
        self._sender.post(frames.IDENT_CONTROLLER, frame, now_ns)


class VehicleOutbox:
    """The vehicle's side: state, feedback, reference, mission, IDENT_VEHICLE."""

    def __init__(self, bus: Transmitter, recorder: FrameSink | None = None) -> None:
        self._sender = _Sender(
            bus,
            (
                frames.STATE_A,
                frames.STATE_B,
                frames.STATE_C,
                frames.ACT_FB,
                frames.REF_PATH,
                frames.REF_SPEED,
                frames.MISSION,
                frames.IDENT_VEHICLE,
            ),
            recorder,
        )
        self._state_counter = 0
        self.last_state_counter = 0
        """of the newest state sent"""
        self._feedback_counter = 0
        self._reference_counter = 0
        self._mission_counter = 0
        self._identity_counter = 0

    @property
    def sent(self) -> int:
        return self._sender.sent

    @property
    def send_failures(self) -> int:
        return self._sender.send_failures

    @property
    def last_failure(self) -> str:
        """Why a frame was not taken, for people; empty as long as all were."""
        return self._sender.last_failure

    def send_state(
        self, state: VehicleState, road: RoadSample, now_ns: int, is_valid: bool = True
    ) -> None:
        """STATE_A, STATE_B and STATE_C with one counter."""
        counter = self.last_state_counter = self._state_counter
        self._state_counter = (counter + 1) % COUNTER_MODULUS
        post = self._sender.post
        post(frames.STATE_A, frames.encode_state_a(state, counter, is_valid), now_ns)
        post(frames.STATE_B, frames.encode_state_b(state, counter, is_valid), now_ns)
        post(frames.STATE_C, frames.encode_state_c(road, counter, is_valid), now_ns)

    def send_feedback(self, applied: ControlInput, now_ns: int) -> None:
        """One ACT_FB."""
        frame = frames.encode_feedback(applied, self._feedback_counter)
        self._feedback_counter = (self._feedback_counter + 1) % COUNTER_MODULUS
        self._sender.post(frames.ACT_FB, frame, now_ns)

    def send_reference(self, path: PathReference, now_ns: int) -> None:
        """REF_PATH and REF_SPEED with one counter."""
        counter = self._reference_counter
        self._reference_counter = (counter + 1) % COUNTER_MODULUS
        post = self._sender.post
        post(frames.REF_PATH, frames.encode_reference_path(path, counter), now_ns)
        post(frames.REF_SPEED, frames.encode_reference_speed(path, counter), now_ns)

    def send_mission(self, mission: Mission, now_ns: int) -> None:
        """One MISSION."""
        frame = frames.encode_mission(mission, self._mission_counter)
        self._mission_counter = (self._mission_counter + 1) % COUNTER_MODULUS
        self._sender.post(frames.MISSION, frame, now_ns)

    def send_identity(self, model_hash: int | None, now_ns: int) -> None:
        """One IDENT_VEHICLE."""
        identity = Identity(dbc_hash(), model_hash)
        frame = frames.encode_vehicle_identity(identity, self._identity_counter)
        self._identity_counter = (self._identity_counter + 1) % COUNTER_MODULUS
        self._sender.post(frames.IDENT_VEHICLE, frame, now_ns)
