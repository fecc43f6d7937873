"""The controller's end of a bus: what it receives with, decides with and sends with."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import can

from rt_controller.bus.identity import model_hash
from rt_controller.bus.log.recorder import Recorder
from rt_controller.bus.messages import Node
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import Outbox
from rt_controller.config import ControllerConfig
from rt_controller.contract.model.bundle import Bundle
from rt_controller.control.low_speed.law import LowSpeedLaw
from rt_controller.control.mpc import Mpc
from rt_controller.planner import choose_low_speed_car
from rt_controller.realtime.clock import TimeSource
from rt_controller.safety.checks import CHECKS, Check
from rt_controller.safety.prediction import MotionPrediction
from rt_controller.safety.stopping_car import LEAST_MODELLED_MPS, StoppingCar
from rt_controller.safety.supervisor import Supervisor
from rt_controller.step import ControlStep


class ControlNode(NamedTuple):
    """The parts of one controller on one bus; a drive and its replay build the same."""

    inbox: Inbox
    outbox: Outbox
    step: ControlStep
    supervisor: Supervisor


def build_node(
    bus: can.BusABC,
    config: ControllerConfig,
    bundle: Bundle,
    mpc: Mpc,
    clock: TimeSource,
    recorder: Recorder | None = None,
    is_fd: bool = False,
    note_call: Callable[[str], None] = lambda name: None,
    checks: Sequence[Check] = CHECKS,
) -> ControlNode:
    """The parts, connected; nothing is sent yet.

    Args:
        bus: the open bus.
        config: settings.
        bundle: the model that `mpc` plans with.
        mpc: the planner.
        clock: of the loop.
        recorder: of frames; None: they are not recorded.
        is_fd: the bus has frames of CAN FD.
        note_call: as of `ControlStep`.
        checks: of the supervisor.

    Raises:
        ArtifactError: the model's encoder cannot be used.
    """
    inbox = Inbox(Node.CONTROLLER, recorder, is_fd=is_fd)
    outbox = Outbox(bus, Node.CONTROLLER, recorder, is_fd=is_fd)
    low_speed_car = choose_low_speed_car(bundle, config.low_speed)
    supervisor = Supervisor(
        MotionPrediction(bundle, bundle.n_observables),
        StoppingCar(
            low_speed_car.geometry,
            low_speed_car.gains.brake_mps2_per_n,
            low_speed_car.gains.throttle_mps2,
            max(low_speed_car.speeds.leave_mps, LEAST_MODELLED_MPS),
        ),
        checks,
    )
    step = ControlStep(
        bus=bus,
        inbox=inbox,
        outbox=outbox,
        mpc=mpc,
        low_speed=LowSpeedLaw(low_speed_car),
        clock=clock,
        model_hash=model_hash(bundle.sha256),
        supervisor=supervisor,
        actuation_periods=config.mpc.actuation_delay,
        note_call=note_call,
    )
    return ControlNode(inbox, outbox, step, supervisor)
