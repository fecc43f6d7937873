"""The messages of the bus: what each contains, and which CAN frames carry it.

The bus uses degrees for the steering wheel and milliseconds; the program uses radians and
nanoseconds. Layouts, units and ranges are in `messages.dbc`.

A new message needs its frames in `messages.dbc`, one `CATALOGUE.define` here, and one call:
`Outbox.send(MESSAGE, content, now_ns)` or `Inbox.newest(MESSAGE)`.
"""

from collections.abc import Callable, Iterable
from enum import StrEnum
from itertools import accumulate, chain, takewhile
from math import degrees, isnan, nan, radians
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

from rt_controller.bus.codec import FrameCodec, FrameSpec
from rt_controller.bus.dbc import DBC_PATH, read_dbc
from rt_controller.contract.faults import NO_REFUSAL, Fault, Refusal
from rt_controller.contract.signals import (
    N_STATES,
    ControlInput,
    CurvaturePreview,
    Mode,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import (
    IDENT_PERIOD_TICKS,
    LONG_COUNTER_MODULUS,
    MISSION_PERIOD_TICKS,
    PERIOD_MS,
)

T = TypeVar("T")


class Command(NamedTuple):
    """Content of ACT_CMD."""

    control: ControlInput
    mode: Mode


class StateSample(NamedTuple):
    """Content of STATE_A, STATE_B and STATE_C: the car at one instant."""

    state: VehicleState
    curvature_per_m: float
    sample_time_ns: int
    """on the vehicle's clock; from the bus: modulo `SAMPLE_TIME_WRAP_NS`, to 0.1 ms"""
    command_echo: int | None
    """state counter of the newest accepted command, None before the first"""
    is_watchdog_braking: bool
    """the vehicle brakes by itself"""
    refusals: Refusal = NO_REFUSAL
    """why it refused the newest command; without `Refusal.BRAKING`"""


class Mission(NamedTuple):
    """Content of MISSION: the request to the controller."""

    is_engaged: bool
    is_reset_requested: bool
    """explicit request to leave SAFE_STOP"""
    mission_id: int
    """0..254"""
    valid_for_ns: int
    """counted from the arrival; at most 60 s, to the millisecond"""


class Heartbeat(NamedTuple):
    """Content of CTRL_HB: state of the controller."""

    mode: Mode
    faults: Fault
    state_counter: int
    """long counter of the state that the command answers, 0..127"""
    compute_time_ns: int | None
    state_age_ns: int | None
    """None: no state yet, or older than the signal can express"""
    qp_iterations: int | None
    """None: no QP was solved"""


class Identity(NamedTuple):
    """Content of IDENT_CONTROLLER and IDENT_VEHICLE."""

    dbc_hash: int
    model_hash: int | None


class Node(StrEnum):
    """The two ends of the bus, as the DBC names them."""

    CONTROLLER = "CONTROLLER"
    VEHICLE = "VEHICLE"


class Message(Generic[T]):
    """One content and the frames that carry it; several frames belong together by their counter."""

    def __init__(
        self,
        sender: Node,
        codecs: tuple[FrameCodec, ...],
        cycle_ticks: int,
        encode: Callable[[T], tuple[float, ...]],
        decode: Callable[..., T],
    ) -> None:
        self.sender = sender
        self.codecs = codecs
        self.cycle_ticks = cycle_ticks
        self.values_of = encode
        """physical values of all frames, flat, from a content"""
        self._decode = decode

    @property
    def parts(self) -> list[tuple[FrameCodec, slice]]:
        """The codec of each frame, and its part of the values."""
        ends = accumulate(codec.n_values for codec in self.codecs)
        return [(c, slice(end - c.n_values, end)) for c, end in zip(self.codecs, ends, strict=True)]

    @property
    def ranges(self) -> list[tuple[float, float]]:
        """Lowest and highest physical value in the DBC, in the order of the values."""
        return [
            (s.raw_min * s.scale + s.offset, s.raw_max * s.scale + s.offset)
            for codec in self.codecs
            for s in codec.signals
        ]

    @property
    def cycle_ms(self) -> float:
        return self.cycle_ticks * PERIOD_MS

    def decode(self, parts: Iterable[tuple[float, ...]]) -> T:
        """The content of what `FrameCodec.read` returned for each frame."""
        return self._decode(*chain.from_iterable(parts))


class Catalogue:
    """All messages of one bus, in the order of their definitions."""

    def __init__(self, path: Path) -> None:
        """Read the DBC."""
        self._dbc = read_dbc(path)
        self.messages: list[Message[Any]] = []

    def define(
        self,
        *frames: FrameSpec,
        cycle_ticks: int,
        encode: Callable[[T], tuple[float, ...]],
        decode: Callable[..., T],
    ) -> Message[T]:
        """A message of the catalogue; its sender and the layout of its frames come from the DBC.

        Args:
            frames: the frames that carry it, in the order of the values.
            cycle_ticks: control periods from one sending to the next.
            encode: physical values of all frames, flat, from the content; a flag other than
                "Valid" comes before the other signals of its frame. NaN means not available.
            decode: the content from the same values, which are within their ranges.
        """
        codecs = tuple(FrameCodec(self._dbc, frame) for frame in frames)
        message = Message(Node(codecs[0].sender), codecs, cycle_ticks, encode, decode)
        self.messages.append(message)
        return message


CATALOGUE = Catalogue(DBC_PATH)

_NS_PER_MS = 1_000_000
_MODES = {int(mode): mode for mode in Mode}


def _encode_input(control: ControlInput) -> tuple[float, ...]:
    return control.throttle, control.brake_n, degrees(control.steer_rad)


def _decode_input(throttle: float, brake_n: float, steer_deg: float) -> ControlInput:
    return ControlInput(throttle, brake_n, radians(steer_deg))


COMMAND = CATALOGUE.define(
    FrameSpec("ACT_CMD", "Mode", ("Throttle", "BrakeForce", "SteeringWheelAngle")),
    cycle_ticks=1,
    encode=lambda command: (command.mode, *_encode_input(command.control)),
    decode=lambda mode, *values: Command(_decode_input(*values), _MODES[mode]),
)
FEEDBACK = CATALOGUE.define(
    FrameSpec(
        "ACT_FB", "Valid", ("AppliedThrottle", "AppliedBrakeForce", "AppliedSteeringWheelAngle")
    ),
    cycle_ticks=1,
    encode=_encode_input,
    decode=_decode_input,
)


def _encode_state(sample: StateSample) -> tuple[float, ...]:
    return (
        *sample.state,
        sample.curvature_per_m,
        sample.sample_time_ns % SAMPLE_TIME_WRAP_NS // _SAMPLE_TIME_LSB_NS * _SAMPLE_TIME.scale,
        nan if sample.command_echo is None else sample.command_echo,
        sample.refusals | (Refusal.BRAKING if sample.is_watchdog_braking else NO_REFUSAL),
    )


def _decode_state(*values: float) -> StateSample:
    curvature_per_m, sample_time_ms, echo, vehicle_faults = values[N_STATES:]
    refusals = Refusal(int(vehicle_faults)) if vehicle_faults else NO_REFUSAL
    is_braking = bool(refusals) and Refusal.BRAKING in refusals
    return StateSample(
        VehicleState(*values[:N_STATES]),
        curvature_per_m,
        round(sample_time_ms / _SAMPLE_TIME.scale) * _SAMPLE_TIME_LSB_NS,
        None if isnan(echo) else int(echo),
        is_braking,
        refusals & ~Refusal.BRAKING if is_braking else refusals,
    )


STATE = CATALOGUE.define(
    FrameSpec("STATE_A", "Valid", ("VelocityX", "VelocityY", "YawRate")),
    FrameSpec("STATE_B", "Valid", ("DeltaS", "LateralError", "HeadingError")),
    FrameSpec(
        "STATE_C",
        "Valid",
        ("Curvature", "SampleTime", "CommandEcho", "VehicleFaults"),
        optional=("CommandEcho",),
    ),
    cycle_ticks=1,
    encode=_encode_state,
    decode=_decode_state,
)
_SAMPLE_TIME = STATE.codecs[2].signals[1]
_SAMPLE_TIME_LSB_NS = round(_SAMPLE_TIME.scale * _NS_PER_MS)
SAMPLE_TIME_WRAP_NS = (_SAMPLE_TIME.raw_max + 1) * _SAMPLE_TIME_LSB_NS
"""the vehicle's sample time restarts at 0 after this time"""

REFERENCE = CATALOGUE.define(
    FrameSpec("REF_PATH", "Valid", ("C0", "C1", "C2")),
    FrameSpec("REF_SPEED", "Valid", ("C3", "SpeedRef", "AccelerationRef")),
    cycle_ticks=1,
    encode=tuple,
    decode=PathReference,
)


def _decode_preview(spacing_m: float, *curvature_per_m: float) -> CurvaturePreview | None:
    if not isnan(sum(curvature_per_m, spacing_m)):
        return CurvaturePreview(spacing_m, *curvature_per_m)
    known = list(takewhile(lambda value: not isnan(value), curvature_per_m))
    if isnan(spacing_m) or not known:
        return None
    known += known[-1:] * (len(curvature_per_m) - len(known))
    return CurvaturePreview(spacing_m, *known)


_NO_PREVIEW = (nan,) * len(CurvaturePreview._fields)
_PREVIEW_A, _PREVIEW_B = ("Spacing", "K0", "K1"), ("K2", "K3", "K4")
PREVIEW = CATALOGUE.define(
    FrameSpec("REF_CURVATURE_A", "Valid", _PREVIEW_A, optional=_PREVIEW_A),
    FrameSpec("REF_CURVATURE_B", "Valid", _PREVIEW_B, optional=_PREVIEW_B),
    cycle_ticks=1,
    encode=lambda preview: tuple(_NO_PREVIEW if preview is None else preview),
    decode=_decode_preview,
)
"""None: the vehicle has no road ahead; a value that is missing is the one before it"""


def _decode_mission(
    engage: float, acknowledge: float, mission_id: float, valid_for_ms: float
) -> Mission:
    return Mission(engage == 1, acknowledge == 1, int(mission_id), round(valid_for_ms * _NS_PER_MS))


MISSION = CATALOGUE.define(
    FrameSpec("MISSION", "Valid", ("Engage", "Acknowledge", "MissionId", "ValidFor")),
    cycle_ticks=MISSION_PERIOD_TICKS,
    encode=lambda mission: (*mission[:3], mission.valid_for_ns / _NS_PER_MS),
    decode=_decode_mission,
)


def _encode_heartbeat(heartbeat: Heartbeat) -> tuple[float, ...]:
    mode, faults, state_counter, compute_time_ns, state_age_ns, qp_iterations = heartbeat
    return (
        mode,
        faults,
        state_counter % LONG_COUNTER_MODULUS,
        nan if compute_time_ns is None else compute_time_ns / _NS_PER_MS,
        nan if state_age_ns is None else state_age_ns / _NS_PER_MS,
        nan if qp_iterations is None else qp_iterations,
    )


def _decode_heartbeat(
    mode: int,
    faults: float,
    state_counter: float,
    compute_time_ms: float,
    state_age_ms: float,
    qp_iterations: float,
) -> Heartbeat:
    return Heartbeat(
        _MODES[mode],
        Fault(int(faults)),
        int(state_counter),
        None if isnan(compute_time_ms) else round(compute_time_ms * _NS_PER_MS),
        None if isnan(state_age_ms) else round(state_age_ms * _NS_PER_MS),
        None if isnan(qp_iterations) else int(qp_iterations),
    )


HEARTBEAT = CATALOGUE.define(
    FrameSpec(
        "CTRL_HB",
        "Mode",
        ("Faults", "StateCounter", "ComputeTime", "StateAge", "QpIterations"),
        optional=("ComputeTime", "StateAge", "QpIterations"),
    ),
    cycle_ticks=1,
    encode=_encode_heartbeat,
    decode=_decode_heartbeat,
)


def _encode_identity(identity: Identity) -> tuple[float, ...]:
    return identity.dbc_hash, nan if identity.model_hash is None else identity.model_hash


def _decode_identity(dbc_hash: float, model_hash: float) -> Identity:
    return Identity(int(dbc_hash), None if isnan(model_hash) else int(model_hash))


CONTROLLER_IDENTITY, VEHICLE_IDENTITY = (
    CATALOGUE.define(
        FrameSpec(name, "Valid", ("DbcHash", "ModelHash"), optional=("ModelHash",)),
        cycle_ticks=IDENT_PERIOD_TICKS,
        encode=_encode_identity,
        decode=_decode_identity,
    )
    for name in ("IDENT_CONTROLLER", "IDENT_VEHICLE")
)
