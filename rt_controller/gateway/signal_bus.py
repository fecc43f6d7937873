"""A CAN bus with the messages of the contract, over a bus on which the car has its own.

The controller reads and writes it like any other bus (`rt-controller --signals`).
"""

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import can

from rt_controller.contract.timing import PERIOD_NS
from rt_controller.gateway.car_end import CarEnd
from rt_controller.gateway.lateral_speed import LateralSpeed
from rt_controller.mapping.car_file import CarFile
from rt_controller.mapping.frame_queue import MAX_FRAMES, FrameQueue


class SignalBus(can.BusABC):
    """The car's end of the contract and its own bus, in the thread of the reader."""

    def __init__(
        self,
        inner: can.BusABC,
        car: CarFile,
        lateral_speed: LateralSpeed,
        now_ns: Callable[[], int],
        *,
        has_wall_clock: bool,
    ) -> None:
        """Translate between `inner` and this bus, which closes `inner`.

        Args:
            inner: the bus of the car.
            car: its mapping.
            lateral_speed: estimates v_y where the car does not send it.
            now_ns: the clock of the reader.
            has_wall_clock: False if time is simulated, and time stamps of frames have no meaning.

        Raises:
            ConfigError, DatasetError: see `CarEnd`.
        """
        self._queue = FrameQueue()
        self.car_end = CarEnd(car, lateral_speed, self._queue)
        self._inner = inner
        self._now_ns = now_ns
        self._has_wall_clock = has_wall_clock
        self._due_ns: int | None = None
        self._last_read_ns = 0
        self.channel_info = f"{inner.channel_info}, translated by {car.path.name}"
        super().__init__(channel=car.path.name)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send the content of a frame of the controller to the car, in its own messages.

        Raises:
            can.CanError: the car's bus does not take a frame.
        """
        if not self.car_end.accept_command(msg, self._now_ns()):
            return
        command = self.car_end.command
        if command is not None:
            for frame in self.car_end.command_frames(*command.content):
                self._inner.send(frame, timeout=timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame of the contract; as python-can's `recv`."""
        until_s = None if timeout is None else time.monotonic() + timeout
        while not self._queue.frames:
            self._exchange()
            if self._queue.frames:
                break
            if until_s is not None and time.monotonic() >= until_s:
                return None
            time.sleep(1e-3)
        return self._queue.frames.popleft()

    def explain_missing(self) -> str:
        """Which signals are missing for a drive, for people; empty if none is."""
        missing = self.car_end.explain_missing(self._now_ns())
        return missing and f"Expected the car on its bus ({self._inner.channel_info}), {missing}"

    def shutdown(self) -> None:
        """Send the last command in every message, whatever its period, and close the car's bus."""
        command = self.car_end.command
        if command is not None and not self._is_shutdown:
            with suppress(can.CanError):
                for frame in self.car_end.last_frames(*command.content):
                    self._inner.send(frame, timeout=0)
        super().shutdown()
        self._inner.shutdown()

    def _exchange(self) -> None:
        """Read the car's frames; once a period, send what the controller receives."""
        now_ns = self._now_ns()
        read_frames(self._inner, self.car_end, now_ns, self._last_read_ns, self._has_wall_clock)
        self._last_read_ns = now_ns
        if self._due_ns is None:
            self._due_ns = now_ns
        if now_ns >= self._due_ns:
            skipped = (now_ns - self._due_ns) // PERIOD_NS
            self.car_end.send(now_ns, skipped)
            self._due_ns += (skipped + 1) * PERIOD_NS


def read_frames(
    bus: can.BusABC, car_end: CarEnd, now_ns: int, last_read_ns: int, has_wall_clock: bool
) -> None:
    """Pass the waiting frames of the car's bus to its end.

    A frame arrived between the last call and this one. Where frames have time stamps of this
    machine, these say when; a clock that was set cannot make it earlier or later than that.
    """
    wall_s = time.time() if has_wall_clock else 0.0
    for _ in range(MAX_FRAMES):
        frame: Any = bus.recv(0)
        if frame is None:
            return
        age_ns = 0
        if has_wall_clock:
            age_ns = round(1e9 * (wall_s - frame.timestamp))
            age_ns = min(max(age_ns, 0), now_ns - last_read_ns)
        car_end.accept(frame, now_ns - age_ns)
