"""What has been received: complete, checked and valid, with the time it arrived.

`counter` is the end-to-end counter of the frames; `arrival_ns` is the reader's clock when the
oldest of them was read from the bus.
"""

from typing import NamedTuple

from rt_controller.bus.frames import Fault
from rt_controller.contract.signals import ControlInput, Mode, PathReference, VehicleState


class StateSnapshot(NamedTuple):
    """The car at one instant: STATE_A, STATE_B and STATE_C of one counter."""

    state: VehicleState
    curvature_per_m: float
    sample_time_ns: int
    """on the vehicle's clock, modulo `SAMPLE_TIME_WRAP_NS`"""
    command_echo: int | None
    """counter of the newest command that the vehicle had accepted"""
    is_watchdog_braking: bool
    counter: int
    arrival_ns: int


class ReferenceSnapshot(NamedTuple):
    """The wanted path and speed: REF_PATH and REF_SPEED of one counter."""

    path: PathReference
    counter: int
    arrival_ns: int


class MissionSnapshot(NamedTuple):
    """What the controller is asked to do."""

    is_engaged: bool
    is_reset_requested: bool
    mission_id: int
    valid_for_ns: int
    """counted from `arrival_ns`"""
    counter: int
    arrival_ns: int


class FeedbackSnapshot(NamedTuple):
    """What the actuators do."""

    applied: ControlInput
    counter: int
    arrival_ns: int


class CommandSnapshot(NamedTuple):
    """What the controller wants."""

    control: ControlInput
    mode: Mode
    counter: int
    arrival_ns: int


class HeartbeatSnapshot(NamedTuple):
    """How the controller is doing."""

    mode: Mode
    faults: Fault
    compute_time_ns: int | None
    state_age_ns: int | None
    qp_iterations: int | None
    counter: int
    arrival_ns: int


class PeerIdentity(NamedTuple):
    """Who is at the other end."""

    dbc_hash: int
    model_hash: int | None
    counter: int
    arrival_ns: int
