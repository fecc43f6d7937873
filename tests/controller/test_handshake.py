"""The controller waits for a vehicle that fits, and refuses a bus on which it must not drive."""

from collections.abc import Iterator

import pytest
from scripted_vehicle import Rig, build_rig, fail

from rt_controller.bus.identity import own_identity
from rt_controller.bus.messages import COMMAND, STATE, VEHICLE_IDENTITY, Command, Identity, Node
from rt_controller.bus.send import Outbox
from rt_controller.contract.errors import BusError
from rt_controller.contract.signals import NEUTRAL_INPUT, Mode
from rt_controller.control.mpc import Mpc
from rt_controller.loop import StopRequest
from rt_controller.session import wait_for_vehicle


@pytest.fixture
def rig(mpc_of_session: Mpc) -> Iterator[Rig]:
    """Nothing was sent or received yet."""
    with build_rig(mpc_of_session, standby_ticks=0) as built:
        yield built


def wait(rig: Rig) -> None:
    wait_for_vehicle(rig.controller_bus, rig.inbox, rig.clock, 0, 2_000_000_000, StopRequest())


def test_it_waits_for_state_path_and_the_identity_of_the_vehicle(rig: Rig) -> None:
    rig.vehicle.after_sending = lambda now_ns: (
        rig.vehicle.outbox.send(VEHICLE_IDENTITY, own_identity(None), now_ns)
        if now_ns > 10**9
        else None
    )
    wait(rig)
    assert rig.clock.now_ns() > 10**9
    assert rig.inbox.newest(STATE) is not None


def test_commands_of_another_controller_on_the_bus_are_an_error(rig: Rig) -> None:
    other = Outbox(rig.vehicle_bus, Node.CONTROLLER)
    rig.vehicle.after_sending = lambda now_ns: other.send(
        COMMAND, Command(NEUTRAL_INPUT, Mode.STANDBY), now_ns
    )
    with pytest.raises(BusError, match="another one"):
        wait(rig)


def test_the_error_after_the_wait_names_the_missing_frames_and_a_remedy(rig: Rig) -> None:
    rig.vehicle.state = None
    with pytest.raises(BusError, match="STATE_A/B/C") as error:
        wait(rig)
    assert "Start sim-bridge" in str(error.value)


def test_the_error_after_the_wait_names_the_option_of_the_other_format(
    rig: Rig, mpc_of_session: Mpc
) -> None:
    fast = Outbox(rig.vehicle_bus, Node.VEHICLE, is_fd=True)
    rig.vehicle.state = None
    rig.vehicle.after_sending = lambda now_ns: fast.send(
        VEHICLE_IDENTITY, own_identity(None, is_fd=True), now_ns
    )
    with pytest.raises(BusError, match=r"classic CAN within 2 s, found \d+ of CAN FD.*--fd"):
        wait(rig)


def test_a_bus_that_cannot_be_read_is_an_error_with_what_to_check(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rig.controller_bus, "recv", fail)
    with pytest.raises(BusError, match=r"expected .*, found .*unplugged\. Check the interface"):
        wait(rig)


def test_another_message_catalogue_is_an_error(rig: Rig) -> None:
    rig.vehicle.after_sending = lambda now_ns: rig.vehicle.outbox.send(
        VEHICLE_IDENTITY, Identity(0xABCD, None), now_ns
    )
    with pytest.raises(BusError, match="0000abcd") as error:
        wait(rig)
    assert "expected" in str(error.value)
    rig.received.drain(rig.vehicle_bus, rig.clock.now_ns())
    assert rig.received.newest(COMMAND) is None


def test_a_stop_request_ends_the_wait(rig: Rig) -> None:
    request = StopRequest()
    rig.vehicle.after_sending = lambda now_ns: request.request()
    wait_for_vehicle(rig.controller_bus, rig.inbox, rig.clock, 0, 2_000_000_000, request)
    assert rig.clock.now_ns() < 10**9
