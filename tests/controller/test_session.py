"""A session is closed after its loop, whatever happened in the main thread."""

from threading import Thread

import pytest

from rt_controller.bus import transport
from rt_controller.config import ControllerConfig
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_mpc
from rt_controller.realtime.clock import LockstepClock
from rt_controller.session import ControllerSession
from rt_controller.settings import BusSettings


def test_a_loop_that_runs_is_stopped_before_its_bus_is_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bundle, config, bus = Bundle.load("lti"), ControllerConfig(), BusSettings(bus="virtual")
    clock = LockstepClock(lambda now_ns: None)
    session = ControllerSession(bus, config, bundle, build_mpc(bundle, config.mpc), clock)
    happened: list[str] = []
    shut_down = transport._shut_down

    def loop(*_: object) -> None:
        while session.stop_requests == 0:
            pass
        happened.append(f"the loop ended after {session.stop_requests} request")

    def note(closed: object) -> None:
        happened.append("the bus was closed")
        shut_down(closed)  # type: ignore[arg-type]

    monkeypatch.setattr(session, "_run", loop)
    monkeypatch.setattr(transport, "_shut_down", note)
    thread: Thread = session.start(None, False, 1.0)
    session.close()
    assert not thread.is_alive()
    assert happened == ["the loop ended after 1 request", "the bus was closed"]
