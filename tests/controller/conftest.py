"""The rig of the controller's own tests."""

from collections.abc import Iterator
from itertools import count

import pytest
from scripted_vehicle import Rig, Vehicle

from rt_controller.bus.inbox import CommandInbox, Inbox
from rt_controller.bus.outbox import ControllerOutbox, VehicleOutbox
from rt_controller.bus.transport import open_bus
from rt_controller.config import MpcSettings
from rt_controller.contract.artifact import load_bundle
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.control.mpc import Mpc
from rt_controller.control.plan import Plan
from rt_controller.realtime.clock import LockstepClock
from rt_controller.session import shipped_model
from rt_controller.step import ControlStep

_channels = count()


@pytest.fixture(scope="session")
def mpc_of_session() -> Mpc:
    settings = MpcSettings()
    return Mpc(load_bundle(shipped_model("lti")), settings.horizon, settings.cost(), INPUT_LIMITS)


@pytest.fixture
def rig(mpc_of_session: Mpc) -> Iterator[Rig]:
    channel = f"controller-test-{next(_channels)}"
    with open_bus("virtual", channel) as vehicle_bus, open_bus("virtual", channel) as bus:
        vehicle = Vehicle(VehicleOutbox(vehicle_bus))
        clock = LockstepClock(PERIOD_NS, vehicle.speak)
        inbox = Inbox()
        step = ControlStep(
            bus=bus,
            inbox=inbox,
            outbox=ControllerOutbox(bus),
            mpc=mpc_of_session,
            plan=Plan(MpcSettings().horizon),
            limits=INPUT_LIMITS,
            clock=clock,
            model_hash=7,
        )
        yield Rig(vehicle, clock, step, mpc_of_session, bus, vehicle_bus, inbox, CommandInbox())
