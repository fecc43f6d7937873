"""A scripted vehicle at the other end of a virtual bus: what the controller's own tests drive."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count

import can

from rt_controller.bus.frames import Mission, RoadSample
from rt_controller.bus.inbox import CommandInbox, Inbox
from rt_controller.bus.outbox import ControllerOutbox, VehicleOutbox
from rt_controller.bus.snapshot import CommandSnapshot
from rt_controller.bus.transport import open_bus
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.control.mpc import Mpc
from rt_controller.control.plan import Plan
from rt_controller.outcome import StepOutcome
from rt_controller.realtime.clock import LockstepClock
from rt_controller.step import ControlStep

CRUISING = VehicleState(20.0, 0.0, 0.0, 0.5, 0.2, 0.01)
STRAIGHT = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)
VALID_NS = 500_000_000
ENGAGED = Mission(is_engaged=True, is_reset_requested=False, mission_id=1, valid_for_ns=VALID_NS)

_channels = count()


@dataclass(slots=True)
class Vehicle:
    """What the scripted vehicle says before each tick; change a field to change what it says."""

    outbox: VehicleOutbox
    state: VehicleState | None = CRUISING
    is_valid: bool = True
    path: PathReference | None = STRAIGHT
    mission: Mission | None = ENGAGED
    is_watchdog_braking: bool = False
    stamped_late_ns: int = 0
    """how old a state is when it is sent"""
    command_echo: int | None = None
    also: Callable[[int], None] = field(default=lambda now_ns: None)

    def speak(self, now_ns: int) -> None:
        if self.state is not None:
            stamp_ns = now_ns - self.stamped_late_ns
            road = RoadSample(0.0, stamp_ns, self.command_echo, self.is_watchdog_braking)
            self.outbox.send_state(self.state, road, now_ns, self.is_valid)
        if self.path is not None:
            self.outbox.send_reference(self.path, now_ns)
        if self.mission is not None:
            self.outbox.send_mission(self.mission, now_ns)
        self.also(now_ns)


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
    heard: CommandInbox

    def tick(self, times: int = 1, skipped: int = 0) -> StepOutcome:
        for _ in range(times):
            self.clock.wait()
            outcome = self.step.run(skipped)
            self.heard.drain(self.vehicle_bus, self.clock.now_ns())
        return outcome

    @property
    def command(self) -> CommandSnapshot:
        """The newest command as the vehicle received it."""
        assert self.heard.command is not None
        return self.heard.command


@contextmanager
def build_rig(mpc: Mpc) -> Iterator[Rig]:
    """A controller with this planner, its scripted vehicle, and the virtual bus between them."""
    channel = f"scripted-vehicle-{next(_channels)}"
    with open_bus("virtual", channel) as vehicle_bus, open_bus("virtual", channel) as bus:
        vehicle = Vehicle(VehicleOutbox(vehicle_bus))
        clock = LockstepClock(PERIOD_NS, vehicle.speak)
        inbox = Inbox()
        step = ControlStep(
            bus=bus,
            inbox=inbox,
            outbox=ControllerOutbox(bus),
            mpc=mpc,
            plan=Plan(mpc.inputs.shape[0]),
            limits=INPUT_LIMITS,
            clock=clock,
            model_hash=7,
        )
        yield Rig(vehicle, clock, step, mpc, bus, vehicle_bus, inbox, CommandInbox())
