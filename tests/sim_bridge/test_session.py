"""Requests to end the run of a bridge."""

from dataclasses import dataclass
from typing import Any, cast

import pytest

from rt_controller.bus.transport import open_bus
from sim_bridge.bridge import Bridge
from sim_bridge.session import BridgeSession

PATIENCE_S = 10.0


@dataclass(slots=True)
class EndlessBridge:
    """A bridge whose controller drives on for some ticks after the end of the mission."""

    ticks_after_end: int
    is_waiting: bool = False
    ticks: int = 0
    is_mission_over: bool = False

    @property
    def is_over(self) -> bool:
        return self.is_mission_over and self.ticks_after_end < 0

    def end_mission(self) -> None:
        self.is_mission_over = True

    def tick(self, _: int) -> None:
        self.ticks += 1
        self.ticks_after_end -= self.is_mission_over

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("requests", "ticks_after_end", "is_waiting"),
    [(1, 2, False), (2, 10**6, False), (1, 10**6, True)],
    ids=["the first ends the mission", "the second ends at once", "no mission yet"],
)
def test_the_first_request_ends_the_mission_and_the_second_one_the_thread(
    requests: int, ticks_after_end: int, is_waiting: bool
) -> None:
    bridge = EndlessBridge(ticks_after_end, is_waiting)
    session = BridgeSession(open_bus("virtual", "session"), cast(Bridge, cast(Any, bridge)))
    thread = session.start(priority=0)
    for _ in range(requests):
        session.request_stop()
    thread.join(PATIENCE_S)
    is_ended = not thread.is_alive()
    session.close()
    assert is_ended
    assert session.is_stop_requested


def test_a_session_that_is_closed_ends_at_once() -> None:
    bridge = EndlessBridge(10**6)
    session = BridgeSession(open_bus("virtual", "session"), cast(Bridge, cast(Any, bridge)))
    thread = session.start(priority=0)
    session.close()
    assert not thread.is_alive()
    assert not session.is_stop_requested
