"""Members of a local bus."""

from collections.abc import Callable, Iterator

import can
import pytest

from rt_controller.bus import local
from rt_controller.bus.transport import close_bus, open_bus


@pytest.fixture
def join(tmp_path, monkeypatch) -> Iterator[Callable[..., can.BusABC]]:
    monkeypatch.setattr(local, "SHARED_MEMORY", tmp_path)
    monkeypatch.setattr(local, "REFRESH_NS", 0)
    buses: list[can.BusABC] = []

    def open_one(channel: str = "road") -> can.BusABC:
        buses.append(open_bus("local", channel))
        return buses[-1]

    yield open_one
    for bus in buses:
        close_bus(bus)
