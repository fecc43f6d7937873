"""Inputs of the supervisor in a tick, and its result: what may be planned from."""

from typing import NamedTuple

from rt_controller.contract.faults import StopCause
from rt_controller.contract.signals import (
    ControlInput,
    CurvaturePreview,
    PathReference,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.isolation import Faulty, SignalMask


class ReceivedInputs(NamedTuple):
    """What one tick received; None: nothing that is fresh and valid."""

    state: VehicleState | None
    """new in this tick"""
    curvature_per_m: float
    """of the state"""
    path: PathReference | None
    preview: CurvaturePreview | None
    """as it arrived, also if it contradicts the curvature"""
    applied: ControlInput | None
    """the command that acted in the last period; None: not known, or not one of this controller"""
    feedback: ControlInput | None
    """of the actuators, new in this tick"""
    is_driven: bool
    """False in STANDBY: nothing is compared, and the checks restart at the state that arrives"""
    is_stopping: bool
    """a safe stop has begun"""
    periods: int
    """since the last tick"""
    late_ticks: int = 0
    """by which the steering wheel is known to be later than it is configured"""


class QualifiedInputs(NamedTuple):
    """What may be planned from."""

    state: VehicleState | None
    """measured where it is accepted, otherwise estimated; None: none has arrived yet"""
    curvature_per_m: float
    path: PathReference | None
    """received or, if it was not, the last one that was accepted"""
    preview: CurvaturePreview | None
    is_measured: bool
    """the whole state arrived in this tick and was accepted"""
    is_path_received: bool
    """the path arrived in time and was accepted"""
    speed_mps: float | None
    """as far as it is measured and accepted: v_x, or from the progress"""
    alarm: StopCause = StopCause.NONE
    """what stops the car"""
    rejection: StopCause = StopCause.NONE
    """why state or path of this tick are not used, or why the drive does not begin"""


def with_replaced_signals(
    measured: VehicleState, expected: VehicleState, faulty: SignalMask
) -> VehicleState:
    """The measured state with the faulty signals of its motion replaced."""
    if faulty == Faulty.NONE:
        return measured
    vx_mps, vy_mps, yaw_rate, ds_m, ey_m, epsi_rad = measured
    if faulty & Faulty.SPEED:
        vx_mps = expected.vx_mps if faulty & Faulty.PROGRESS else ds_m / PERIOD_S
    if faulty & Faulty.PROGRESS:
        ds_m = vx_mps * PERIOD_S
    if faulty & Faulty.LATERAL_SPEED:
        vy_mps = expected.vy_mps
    if faulty & Faulty.YAW_RATE:
        yaw_rate = expected.yaw_rate_radps
    return VehicleState(vx_mps, vy_mps, yaw_rate, ds_m, ey_m, epsi_rad)
