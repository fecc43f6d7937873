"""The messages of the bus: what each contains and how its signals are computed.

The bus uses degrees for the steering wheel and milliseconds; the program uses radians and
nanoseconds. Layouts, units and ranges are in `messages.dbc` and `messages_fd.dbc`.
"""

from itertools import takewhile
from math import degrees, isnan, nan, radians

from rt_controller.bus.codec import FrameSpec
from rt_controller.bus.contents import (
    NO_REFUSAL,
    Command,
    Fault,
    Heartbeat,
    Identity,
    Mission,
    Refusal,
    StateSample,
)
from rt_controller.bus.dbc import DBC_PATH, FD_DBC_PATH
from rt_controller.bus.message import Catalogue
from rt_controller.contract.schema import N_STATES
from rt_controller.contract.signals import (
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
)

CATALOGUE = Catalogue(DBC_PATH, FD_DBC_PATH)

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
    refusals = Refusal(int(vehicle_faults))
    return StateSample(
        VehicleState(*values[:N_STATES]),
        curvature_per_m,
        round(sample_time_ms / _SAMPLE_TIME.scale) * _SAMPLE_TIME_LSB_NS,
        None if isnan(echo) else int(echo),
        Refusal.BRAKING in refusals,
        refusals & ~Refusal.BRAKING,
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
    fd_name="STATE",
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
    fd_name="REF",
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
    fd_name="REF_CURVATURE",
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
