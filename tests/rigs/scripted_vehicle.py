"""A scripted vehicle at the other end of a virtual bus, for the tests of the controller."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from typing import Literal

import can
from rolling_car import ASSUMED

from rt_controller.bus.messages import (
    COMMAND,
    HEARTBEAT,
    MISSION,
    PREVIEW,
    REFERENCE,
    STATE,
    Command,
    Heartbeat,
    Mission,
    Node,
    StateSample,
)
from rt_controller.bus.receive import Inbox, Received
from rt_controller.bus.send import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.faults import StopCause
from rt_controller.contract.signals import CurvaturePreview, Mode, PathReference, VehicleState
from rt_controller.control.low_speed import LowSpeedLaw
from rt_controller.control.mpc import Mpc
from rt_controller.realtime.clock import LockstepClock
from rt_controller.safety.supervisor import Supervisor
from rt_controller.safety.tick import Tick
from rt_controller.step import ControlStep

CRUISING = VehicleState(20.0, 0.0, 0.0, 0.5, 0.2, 0.01)
STANDING = CRUISING._replace(vx_mps=0.0, ds_m=0.0)
STRAIGHT = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)
VALID_NS = 500_000_000
ENGAGED = Mission(is_engaged=True, is_reset_requested=False, mission_id=1, valid_for_ns=VALID_NS)

_channels = count()


def fail(*_: object, **__: object) -> None:
    """A `send` or `recv` of a bus that is unplugged."""
    raise can.CanOperationError("unplugged")


def mode_and_cause(result: Tick) -> tuple[Mode, StopCause]:
    return result.mode, result.cause


@dataclass(slots=True)
class Vehicle:
    """What the scripted vehicle sends before each tick; change a field to change what is sent."""

    outbox: Outbox
    bus: can.BusABC
    received: Inbox
    state: VehicleState | None = CRUISING
    is_valid: bool = True
    path: PathReference | None = STRAIGHT
    preview: CurvaturePreview | None = None
    """None: not sent"""
    mission: Mission | None = ENGAGED
    is_watchdog_braking: bool = False
    stamped_late_ns: int = 0
    """how old a state is when it is sent"""
    command_echo: int | Literal["newest"] | None = "newest"
    """long counter of a command, or that of the newest one"""
    counter: int = -1
    """of the last state and path, sent or not"""
    after_sending: Callable[[int], None] = field(default=lambda now_ns: None)

    @property
    def echo(self) -> int | None:
        if self.command_echo != "newest":
            return self.command_echo
        heartbeat = self.received.newest(HEARTBEAT)
        return None if heartbeat is None else heartbeat.content.state_counter

    def send(self, now_ns: int) -> None:
        self.counter += 1
        self.received.drain(self.bus, now_ns)
        if self.state is not None:
            stamp_ns = now_ns - self.stamped_late_ns
            sample = StateSample(self.state, 0.0, stamp_ns, self.echo, self.is_watchdog_braking)
            self.outbox.send(STATE, sample, now_ns, counter=self.counter, is_valid=self.is_valid)
        if self.path is not None:
            self.outbox.send(REFERENCE, self.path, now_ns, counter=self.counter)
        if self.preview is not None:
            self.outbox.send(PREVIEW, self.preview, now_ns, counter=self.counter)
        if self.mission is not None:
            self.outbox.send(MISSION, self.mission, now_ns)
        self.after_sending(now_ns)


@dataclass(slots=True)
class Rig:
    """A controller and its scripted vehicle, ticked in lockstep."""

    vehicle: Vehicle
    clock: LockstepClock
    step: ControlStep
    mpc: Mpc
    controller_bus: can.BusABC
    vehicle_bus: can.BusABC
    inbox: Inbox
    received: Inbox

    def tick(self, times: int = 1, skipped: int = 0) -> Tick:
        for _ in range(times):
            self.clock.wait()
            result = self.step.run(skipped)
            self.received.drain(self.vehicle_bus, self.clock.now_ns())
        return result

    def tick_in_standby(self, times: int) -> None:
        """Ticks without a mission: afterwards the states are used and commands are echoed."""
        mission, self.vehicle.mission = self.vehicle.mission, None
        for _ in range(times):
            self.tick()
        self.vehicle.mission = mission

    @property
    def command(self) -> Received[Command]:
        """The newest command as the vehicle received it."""
        command = self.received.newest(COMMAND)
        assert command is not None
        return command

    @property
    def heartbeat(self) -> Heartbeat:
        """The newest heartbeat as the vehicle received it."""
        heartbeat = self.received.newest(HEARTBEAT)
        assert heartbeat is not None
        return heartbeat.content


STANDBY_TICKS = 3


@contextmanager
def build_rig(mpc: Mpc, standby_ticks: int = STANDBY_TICKS) -> Iterator[Rig]:
    """A controller with this planner, its scripted vehicle, and the virtual bus between them."""
    channel = f"scripted-vehicle-{next(_channels)}"
    with open_bus("virtual", channel) as vehicle_bus, open_bus("virtual", channel) as bus:
        received = Inbox(Node.VEHICLE)
        vehicle = Vehicle(Outbox(vehicle_bus, Node.VEHICLE), vehicle_bus, received)
        clock = LockstepClock(vehicle.send)
        inbox = Inbox(Node.CONTROLLER)
        step = ControlStep(
            bus=bus,
            inbox=inbox,
            outbox=Outbox(bus, Node.CONTROLLER),
            planner=mpc,
            low_speed=LowSpeedLaw(ASSUMED),
            clock=clock,
            model_hash=7,
            supervisor=Supervisor(checks=()),
        )
        rig = Rig(vehicle, clock, step, mpc, bus, vehicle_bus, inbox, received)
        rig.tick_in_standby(standby_ticks)
        yield rig
