"""A pause of the program that listens is not taken for a gap of the frames."""

import itertools
from collections import deque
from typing import cast

import can
import pytest

from rt_controller.terminal.listening import Listening

PERIOD_S, PAUSE_FROM_S, PAUSE_TO_S = 0.025, 1.0, 1.7
EPOCH_S = 1000.0


class PausedBus:
    """A frame every period; its reader is stopped once. Its clock is advanced by reading."""

    def __init__(self, is_stamped: bool, silent: tuple[float, float] = (9.0, 9.0)) -> None:
        self.now_s = 0.0
        times = (PERIOD_S * k for k in range(120))
        self._due = deque(each for each in times if not silent[0] < each < silent[1])
        self._is_stamped = is_stamped

    def recv(self, timeout: float) -> can.Message | None:
        if self._due and self._due[0] > self.now_s:
            self.now_s = min(self.now_s + timeout, self._due[0])
        if PAUSE_FROM_S <= self.now_s < PAUSE_TO_S:
            self.now_s = PAUSE_TO_S
        if not self._due or self._due[0] > self.now_s:
            return None
        arrival_s = self._due.popleft()
        return can.Message(timestamp=EPOCH_S + (arrival_s if self._is_stamped else self.now_s))


def listen(bus: PausedBus) -> tuple[Listening, list[float]]:
    """Also the times between two frames."""
    listening = Listening(
        cast("can.BusABC", bus), 2.5, lambda: bus.now_s, lambda: EPOCH_S + bus.now_s
    )
    times = [time_s for time_s, _ in listening.frames()]
    return listening, [b - a for a, b in itertools.pairwise(times)]


@pytest.mark.parametrize("is_stamped", [True, False])
def test_frames_that_waited_in_a_pause_leave_no_gap(is_stamped: bool) -> None:
    listening, steps = listen(PausedBus(is_stamped))
    assert max(steps) < 2.0 * PERIOD_S
    assert min(steps) >= 0.0
    assert len(listening.pauses_s) == 1
    assert "this program was not run for 0.7" in (listening.explain_pauses() or "")


@pytest.mark.parametrize("is_stamped", [True, False])
def test_frames_that_were_missing_in_a_pause_leave_a_gap(is_stamped: bool) -> None:
    _, steps = listen(PausedBus(is_stamped, silent=(1.02, 1.66)))
    assert max(steps) > 5.0 * PERIOD_S


def test_a_gap_without_a_pause_stays_one_and_nothing_is_said_of_a_pause() -> None:
    bus = PausedBus(is_stamped=True, silent=(0.2, 0.8))
    bus_steps = Listening(
        cast("can.BusABC", bus), 0.95, lambda: bus.now_s, lambda: EPOCH_S + bus.now_s
    )
    times = [time_s for time_s, _ in bus_steps.frames()]
    assert max(b - a for a, b in itertools.pairwise(times)) > 0.5
    assert bus_steps.explain_pauses() is None
