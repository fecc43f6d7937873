"""A session waits for a vehicle that fits, and is closed after its loop."""

from collections.abc import Iterator
from threading import Thread

import pytest
from scripted_vehicle import Rig, build_rig, fail

from rt_controller.bus import transport
from rt_controller.bus.identity import own_identity
from rt_controller.bus.messages import COMMAND, STATE, VEHICLE_IDENTITY, Command, Identity, Node
from rt_controller.bus.send import Outbox
from rt_controller.config import ControllerConfig
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import NEUTRAL_INPUT, Mode
from rt_controller.control.mpc import Mpc
from rt_controller.loop import StopRequest
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_mpc
from rt_controller.realtime.clock import LockstepClock
from rt_controller.session import ControllerSession, wait_for_vehicle
from rt_controller.settings import BusSettings


@pytest.fixture
def waiting(mpc_of_session: Mpc) -> Iterator[Rig]:
    """Nothing was sent or received yet."""
    with build_rig(mpc_of_session, standby_ticks=0) as built:
        yield built


def wait(rig: Rig) -> None:
    wait_for_vehicle(rig.controller_bus, rig.inbox, rig.clock, 0, 2_000_000_000, StopRequest())


def test_it_waits_for_state_path_and_the_identity_of_the_vehicle(waiting):
    rig = waiting
    rig.vehicle.after_sending = lambda now_ns: (
        rig.vehicle.outbox.send(VEHICLE_IDENTITY, own_identity(None), now_ns)
        if now_ns > 10**9
        else None
    )
    wait(rig)
    assert rig.clock.now_ns() > 10**9
    assert rig.inbox.newest(STATE) is not None


def test_a_stop_request_ends_the_wait(waiting):
    rig, request = waiting, StopRequest()
    rig.vehicle.after_sending = lambda now_ns: request.request()
    wait_for_vehicle(rig.controller_bus, rig.inbox, rig.clock, 0, 2_000_000_000, request)
    assert rig.clock.now_ns() < 10**9


def send_commands(rig: Rig) -> None:
    other, standby = Outbox(rig.vehicle_bus, Node.CONTROLLER), Command(NEUTRAL_INPUT, Mode.STANDBY)
    rig.vehicle.after_sending = lambda now_ns: other.send(COMMAND, standby, now_ns)


def send_another_catalogue(rig: Rig) -> None:
    send, other = rig.vehicle.outbox.send, Identity(0xABCD, None)
    rig.vehicle.after_sending = lambda now_ns: send(VEHICLE_IDENTITY, other, now_ns)


@pytest.mark.parametrize(
    ("disturb", "expected"),
    [
        (send_commands, "another one"),
        (lambda rig: setattr(rig.vehicle, "state", None), "STATE_A/B/C.*Start sim-bridge"),
        (
            lambda rig: setattr(rig.controller_bus, "recv", fail),
            r"expected .*, found .*unplugged\. Check the interface",
        ),
        (send_another_catalogue, "expected .*0000abcd"),
    ],
)
def test_a_bus_on_which_it_must_not_drive_is_refused_with_a_remedy(waiting, disturb, expected):
    disturb(waiting)
    with pytest.raises(BusError, match=f"(?s){expected}"):
        wait(waiting)
    waiting.received.drain(waiting.vehicle_bus, waiting.clock.now_ns())
    own = waiting.received.newest(COMMAND)
    assert own is None or disturb is send_commands


def test_a_loop_that_runs_is_stopped_before_its_bus_is_closed(monkeypatch):
    bundle, config, bus = Bundle.load("lti"), ControllerConfig(), BusSettings(bus="virtual")
    clock = LockstepClock(lambda now_ns: None)
    session = ControllerSession(bus, config, bundle, build_mpc(bundle, config.mpc), clock)
    happened: list[str] = []
    shut_down = transport._shut_down

    def loop(*_):
        while session.stop_requests == 0:
            pass
        happened.append(f"the loop ended after {session.stop_requests} request")

    def note(closed):
        happened.append("the bus was closed")
        shut_down(closed)

    monkeypatch.setattr(session, "_run", loop)
    monkeypatch.setattr(transport, "_shut_down", note)
    thread: Thread = session.start(None, False, 1.0)
    session.close()
    assert not thread.is_alive()
    assert happened == ["the loop ended after 1 request", "the bus was closed"]
