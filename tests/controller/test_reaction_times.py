"""Times from a loss to its reaction, in simulated time, over classic CAN and over CAN FD."""

from collections.abc import Iterator

import pytest
from scripted_vehicle import Rig, build_rig

from rt_controller.contract.faults import Fault
from rt_controller.contract.signals import Mode
from rt_controller.control.mpc import Mpc

FLAGGED_NS, STOPPED_NS = 50_000_000, 125_000_000


@pytest.fixture(params=[False, True], ids=["classic", "fd"])
def rig(mpc_of_session: Mpc, request: pytest.FixtureRequest) -> Iterator[Rig]:
    with build_rig(mpc_of_session, is_fd=request.param) as built:
        yield built


def test_a_lost_state_is_flagged_after_50_ms_and_stops_the_car_after_125_ms_at_most(
    rig: Rig,
) -> None:
    assert rig.tick(20).mode is Mode.NOMINAL
    last_state_ns = rig.clock.now_ns()
    rig.vehicle.state = None
    flagged_ns, stopped_ns = [], []
    for _ in range(8):
        result = rig.tick()
        after_ns = rig.clock.now_ns() - last_state_ns
        if rig.heartbeat.faults & Fault.STATE_STALE:
            flagged_ns.append(after_ns)
        if rig.command.content.mode is Mode.SAFE_STOP:
            stopped_ns.append(after_ns)
            assert result.control.throttle == 0.0
    assert flagged_ns[0] <= FLAGGED_NS
    assert stopped_ns[0] <= STOPPED_NS


def test_a_state_with_a_damaged_frame_is_flagged_as_soon_as_a_lost_one(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig.tick(20)
    last_state_ns = rig.clock.now_ns()
    receive = rig.controller_bus.recv

    def damage(timeout: float | None = None):  # type: ignore[no-untyped-def]
        frame = receive(timeout)
        if frame is not None:
            frame.data[-1] ^= 1
        return frame

    monkeypatch.setattr(rig.controller_bus, "recv", damage)
    rig.tick()
    assert rig.clock.now_ns() - last_state_ns <= FLAGGED_NS
    assert rig.heartbeat.faults & Fault.STATE_STALE
