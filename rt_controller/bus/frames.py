"""What every frame means: contract types in, protected bytes out, and back.

Pure functions, one pair for each message. The bus speaks degrees for the steering wheel and
milliseconds; the program speaks radians and nanoseconds. Decoders return None for a frame that
must not be used: a value is missing or out of range, or the sender says so itself.
"""

from enum import IntFlag
from math import degrees, isnan, nan, radians
from typing import NamedTuple

from rt_controller.bus.codec import (
    DBC_PATH,
    Frame,
    compile_codec,
    nibble_of,
    read_catalogue,
)
from rt_controller.contract.signals import ControlInput, Mode, PathReference, VehicleState

_CATALOGUE = read_catalogue(DBC_PATH)
_IDENTITY = ("DbcHash", "ModelHash")

ACT_CMD = compile_codec(
    _CATALOGUE, "ACT_CMD", "Mode", ("Throttle", "BrakeForce", "SteeringWheelAngle")
)
STATE_A = compile_codec(_CATALOGUE, "STATE_A", "Valid", ("VelocityX", "VelocityY", "YawRate"))
STATE_B = compile_codec(_CATALOGUE, "STATE_B", "Valid", ("DeltaS", "LateralError", "HeadingError"))
STATE_C = compile_codec(
    _CATALOGUE, "STATE_C", "Valid", ("Curvature", "SampleTime", "CommandEcho", "Watchdog")
)
ACT_FB = compile_codec(
    _CATALOGUE,
    "ACT_FB",
    "Valid",
    ("AppliedThrottle", "AppliedBrakeForce", "AppliedSteeringWheelAngle"),
)
REF_PATH = compile_codec(_CATALOGUE, "REF_PATH", "Valid", ("C0", "C1", "C2"))
REF_SPEED = compile_codec(_CATALOGUE, "REF_SPEED", "Valid", ("C3", "SpeedRef", "AccelerationRef"))
MISSION = compile_codec(
    _CATALOGUE, "MISSION", "Valid", ("Engage", "Acknowledge", "MissionId", "ValidFor")
)
CTRL_HB = compile_codec(
    _CATALOGUE, "CTRL_HB", "Mode", ("Faults", "ComputeTime", "StateAge", "QpIterations")
)
IDENT_CONTROLLER = compile_codec(_CATALOGUE, "IDENT_CONTROLLER", "Valid", _IDENTITY)
IDENT_VEHICLE = compile_codec(_CATALOGUE, "IDENT_VEHICLE", "Valid", _IDENTITY)
CODECS = (
    ACT_CMD,
    STATE_A,
    STATE_B,
    STATE_C,
    ACT_FB,
    REF_PATH,
    REF_SPEED,
    MISSION,
    CTRL_HB,
    IDENT_CONTROLLER,
    IDENT_VEHICLE,
)

_VALID = 1
_NS_PER_MS = 1_000_000
_MODES = {int(mode): mode for mode in Mode}

_SAMPLE_TIME = STATE_C.signals[1]
_SAMPLE_TIME_LSB_NS = round(_SAMPLE_TIME.scale * _NS_PER_MS)
SAMPLE_TIME_WRAP_NS = (_SAMPLE_TIME.raw_max + 1) * _SAMPLE_TIME_LSB_NS
"""the vehicle's sample time starts again from 0 here"""


class Fault(IntFlag):
    """The fault bits of CTRL_HB."""

    STATE_STALE = 1
    STATE_INVALID = 2
    SOLVER_FAILED = 4
    DEADLINE_MISSED = 8
    MISSION_MISSING = 16
    BUS_FAULT = 32
    PEER_MISMATCH = 64


class Command(NamedTuple):
    """What ACT_CMD says."""

    control: ControlInput
    mode: Mode


class RoadSample(NamedTuple):
    """What STATE_C says: the road under the car, and the sample's place in time."""

    curvature_per_m: float
    sample_time_ns: int
    """on the vehicle's clock; from the bus: modulo `SAMPLE_TIME_WRAP_NS`, to 0.1 ms"""
    command_echo: int | None
    """counter of the newest accepted command, None before the first"""
    is_watchdog_braking: bool
    """the vehicle brakes because commands stopped"""


class Mission(NamedTuple):
    """What MISSION says."""

    is_engaged: bool
    is_reset_requested: bool
    """explicit request to leave SAFE_STOP"""
    mission_id: int
    """0..254"""
    valid_for_ns: int
    """from its arrival on; at most 60 s, to the millisecond"""


class Heartbeat(NamedTuple):
    """What CTRL_HB says."""

    mode: Mode
    faults: Fault
    compute_time_ns: int | None
    state_age_ns: int | None
    """None: no state yet, or older than the bus can say"""
    qp_iterations: int | None
    """None: no plan was asked of the solver"""


class Identity(NamedTuple):
    """What IDENT_CONTROLLER and IDENT_VEHICLE say."""

    dbc_hash: int
    model_hash: int | None


class PathPart(NamedTuple):
    """What REF_PATH says: the first three coefficients of the path."""

    c0_m: float
    c1: float
    c2_per_m: float


class SpeedPart(NamedTuple):
    """What REF_SPEED says: the last coefficient of the path, and the speed."""

    c3_per_m2: float
    v_mps: float
    a_mps2: float


def encode_command(control: ControlInput, mode: Mode, counter: int) -> bytes:
    """ACT_CMD."""
    throttle, brake_n, steer_rad = control
    return ACT_CMD.encode((throttle, brake_n, degrees(steer_rad)), counter, mode)


def decode_command(frame: Frame) -> Command | None:
    """What an ACT_CMD asks for."""
    throttle, brake_n, steer_deg = ACT_CMD.decode(frame)
    mode = _MODES.get(nibble_of(frame))
    if mode is None or isnan(throttle + brake_n + steer_deg):
        return None
    return Command(ControlInput(throttle, brake_n, radians(steer_deg)), mode)


def encode_state_a(state: VehicleState, counter: int, is_valid: bool = True) -> bytes:
    """STATE_A: v_x, v_y, yaw rate."""
    return STATE_A.encode(state[:3], counter, is_valid)


def decode_state_a(frame: Frame) -> tuple[float, ...] | None:
    """(v_x, v_y, yaw rate): the first half of a `VehicleState`."""
    values = STATE_A.decode(frame)
    return values if nibble_of(frame) == _VALID and not isnan(sum(values)) else None


def encode_state_b(state: VehicleState, counter: int, is_valid: bool = True) -> bytes:
    """STATE_B: progress, lateral error, heading error."""
    return STATE_B.encode(state[3:], counter, is_valid)


def decode_state_b(frame: Frame) -> tuple[float, ...] | None:
    """(progress, lateral error, heading error): the second half of a `VehicleState`."""
    values = STATE_B.decode(frame)
    return values if nibble_of(frame) == _VALID and not isnan(sum(values)) else None


def encode_state_c(road: RoadSample, counter: int, is_valid: bool = True) -> bytes:
    """STATE_C: the road under the car."""
    ticks = road.sample_time_ns % SAMPLE_TIME_WRAP_NS // _SAMPLE_TIME_LSB_NS
    sample_time_ms = ticks * _SAMPLE_TIME.scale
    echo = nan if road.command_echo is None else road.command_echo
    values = (road.curvature_per_m, sample_time_ms, echo, road.is_watchdog_braking)
    return STATE_C.encode(values, counter, is_valid)


def decode_state_c(frame: Frame) -> RoadSample | None:
    """The road under the car; only the echo may be missing."""
    curvature_per_m, sample_time_ms, echo, watchdog = STATE_C.decode(frame)
    if nibble_of(frame) != _VALID or isnan(curvature_per_m + sample_time_ms + watchdog):
        return None
    return RoadSample(
        curvature_per_m,
        round(sample_time_ms / _SAMPLE_TIME.scale) * _SAMPLE_TIME_LSB_NS,
        None if isnan(echo) else int(echo),
        watchdog == 1,
    )


def encode_feedback(applied: ControlInput, counter: int) -> bytes:
    """ACT_FB."""
    throttle, brake_n, steer_rad = applied
    return ACT_FB.encode((throttle, brake_n, degrees(steer_rad)), counter, _VALID)


def decode_feedback(frame: Frame) -> ControlInput | None:
    """What the actuators do."""
    throttle, brake_n, steer_deg = ACT_FB.decode(frame)
    if nibble_of(frame) != _VALID or isnan(throttle + brake_n + steer_deg):
        return None
    return ControlInput(throttle, brake_n, radians(steer_deg))


def encode_reference_path(path: PathReference, counter: int) -> bytes:
    """REF_PATH: c0, c1, c2."""
    return REF_PATH.encode((path.c0_m, path.c1, path.c2_per_m), counter, _VALID)


def decode_reference_path(frame: Frame) -> PathPart | None:
    """c0, c1, c2."""
    part = PathPart(*REF_PATH.decode(frame))
    return part if nibble_of(frame) == _VALID and not isnan(sum(part)) else None


def encode_reference_speed(path: PathReference, counter: int) -> bytes:
    """REF_SPEED: c3, speed, acceleration."""
    return REF_SPEED.encode((path.c3_per_m2, path.v_mps, path.a_mps2), counter, _VALID)


def decode_reference_speed(frame: Frame) -> SpeedPart | None:
    """c3, speed, acceleration."""
    part = SpeedPart(*REF_SPEED.decode(frame))
    return part if nibble_of(frame) == _VALID and not isnan(sum(part)) else None


def encode_mission(mission: Mission, counter: int) -> bytes:
    """MISSION."""
    values = (
        mission.is_engaged,
        mission.is_reset_requested,
        mission.mission_id,
        mission.valid_for_ns / _NS_PER_MS,
    )
    return MISSION.encode(values, counter, _VALID)


def decode_mission(frame: Frame) -> Mission | None:
    """What the controller is asked to do."""
    values = MISSION.decode(frame)
    if nibble_of(frame) != _VALID or isnan(sum(values)):
        return None
    engage, acknowledge, mission_id, valid_for_ms = values
    return Mission(engage == 1, acknowledge == 1, int(mission_id), round(valid_for_ms * _NS_PER_MS))


def encode_heartbeat(heartbeat: Heartbeat, counter: int) -> bytes:
    """CTRL_HB."""
    mode, faults, compute_time_ns, state_age_ns, qp_iterations = heartbeat
    values = (
        faults,
        nan if compute_time_ns is None else compute_time_ns / _NS_PER_MS,
        nan if state_age_ns is None else state_age_ns / _NS_PER_MS,
        nan if qp_iterations is None else qp_iterations,
    )
    return CTRL_HB.encode(values, counter, mode)


def decode_heartbeat(frame: Frame) -> Heartbeat | None:
    """How the controller is doing; the times and the iterations may be missing."""
    faults, compute_time_ms, state_age_ms, qp_iterations = CTRL_HB.decode(frame)
    mode = _MODES.get(nibble_of(frame))
    if mode is None or isnan(faults):
        return None
    return Heartbeat(
        mode,
        Fault(int(faults)),
        None if isnan(compute_time_ms) else round(compute_time_ms * _NS_PER_MS),
        None if isnan(state_age_ms) else round(state_age_ms * _NS_PER_MS),
        None if isnan(qp_iterations) else int(qp_iterations),
    )


def encode_controller_identity(identity: Identity, counter: int) -> bytes:
    """IDENT_CONTROLLER."""
    return IDENT_CONTROLLER.encode(_identity_values(identity), counter, _VALID)


def encode_vehicle_identity(identity: Identity, counter: int) -> bytes:
    """IDENT_VEHICLE."""
    return IDENT_VEHICLE.encode(_identity_values(identity), counter, _VALID)


def decode_controller_identity(frame: Frame) -> Identity | None:
    """Who the controller is; the model may be missing."""
    return _identity(frame, IDENT_CONTROLLER.decode(frame))


def decode_vehicle_identity(frame: Frame) -> Identity | None:
    """Who the vehicle is; the model may be missing."""
    return _identity(frame, IDENT_VEHICLE.decode(frame))


def _identity(frame: Frame, values: tuple[float, ...]) -> Identity | None:
    dbc_hash, model_hash = values
    if nibble_of(frame) != _VALID or isnan(dbc_hash):
        return None
    return Identity(int(dbc_hash), None if isnan(model_hash) else int(model_hash))


def _identity_values(identity: Identity) -> tuple[float, float]:
    return identity.dbc_hash, nan if identity.model_hash is None else identity.model_hash
