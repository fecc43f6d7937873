"""The frames of a bus with their times of arrival, also if this program was not run meanwhile."""

import time
from collections.abc import Callable, Iterator

import can

_LONGEST_WAIT_S = 0.02
_PAUSE_S = 0.05
"""between two reads, from which on this program was not run; the shortest gap that is a fault"""
_READING_S = 0.01
"""largest age of a frame that is stamped when it is read"""
_MOST_FRAMES = 100_000
"""that can wait"""


class Listening:
    """Reads a bus for a time.

    Frames that waited in a pause of this program were read in one burst. They get the time of
    their stamp if it lies in the pause (kernel, adapter), else they are spread over it evenly, so
    that frames which really were missing still leave a gap.
    """

    def __init__(
        self,
        bus: can.BusABC,
        listen_s: float,
        now_s: Callable[[], float] = time.monotonic,
        wall_s: Callable[[], float] = time.time,
    ) -> None:
        """Read `bus` for `listen_s`, with these clocks."""
        self.pauses_s: list[float] = []
        """for how long this program was not run, each time"""
        self._bus = bus
        self._listen_s = listen_s
        self._now_s, self._wall_s = now_s, wall_s

    def frames(self) -> Iterator[tuple[float, can.Message]]:
        """Each frame with its time of arrival in s."""
        last_s = self._now_s()
        end_s = last_s + self._listen_s
        while last_s < end_s:
            frame = self._bus.recv(min(_LONGEST_WAIT_S, end_s - last_s))
            now_s = self._now_s()
            if now_s - last_s > _PAUSE_S:
                self.pauses_s.append(now_s - last_s)
                yield from self._waiting(frame, last_s, now_s)
            elif frame is not None:
                yield now_s, frame
            last_s = now_s

    def explain_pauses(self) -> str | None:
        """A sentence about the pauses; None without any."""
        if not self.pauses_s:
            return None
        return (
            f"this program was not run for {max(self.pauses_s):.3g} s at most, "
            f"{sum(self.pauses_s):.3g} s in all: frames that waited meanwhile count as received in "
            f"time. If a gap is reported, repeat the check on a machine with less load."
        )

    def _waiting(
        self, first: can.Message | None, from_s: float, to_s: float
    ) -> Iterator[tuple[float, can.Message]]:
        """The frames that arrived in a pause."""
        waiting = []
        while first is not None:
            waiting.append(first)
            first = self._bus.recv(0) if len(waiting) < _MOST_FRAMES else None
        wall_s, pause_s = self._wall_s(), to_s - from_s
        ages_s = [wall_s - each.timestamp for each in waiting]
        is_stamped = waiting and min(ages_s) >= 0.0 and _READING_S < max(ages_s) <= 2.0 * pause_s
        for k, (frame, age_s) in enumerate(zip(waiting, ages_s, strict=True), start=1):
            even_s = from_s + pause_s * k / len(waiting)
            yield (max(from_s, to_s - age_s) if is_stamped else even_s), frame
