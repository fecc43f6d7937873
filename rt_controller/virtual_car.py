"""Both ends in one process: the simulated car on a virtual bus, beside the controller.

The only module of the controller that imports the simulation, and only when it is asked for; the
program in a vehicle does not use it.
"""

import threading
from typing import TYPE_CHECKING

from rt_controller.car_settings import CAR_PRIORITY, CarSettings
from rt_controller.config import BusSettings, Pace
from rt_controller.contract.errors import needs_extra
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.realtime.clock import Clock, LockstepClock, RealtimeClock

if TYPE_CHECKING:
    from sim_bridge.plant.protocol import Plant
    from sim_bridge.session import BridgeSession


class VirtualCar:
    """The simulated car and its bridge, as a thread or in lockstep."""

    def __init__(self, session: "BridgeSession", priority: int) -> None:
        self._session = session
        self._priority = priority
        self._leave = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def plant_failure(self) -> str | None:
        """Why the plant stopped giving numbers in mid-drive; None where it did not."""
        return self._session.bridge.summary().plant_failure

    def clock(self, pace: Pace) -> Clock:
        """The clock that the controller shares with this car."""
        if pace is Pace.LOCKSTEP:
            return LockstepClock(PERIOD_NS, self._session.bridge.tick)
        return RealtimeClock(PERIOD_NS)

    def start(self) -> None:
        """In real time: let the car run on its own, beside the controller."""
        self._thread = threading.Thread(
            target=self._session.run,
            args=(RealtimeClock(PERIOD_NS), self._leave.is_set, self._priority),
            name="car",
        )
        self._thread.start()

    def close(self) -> None:
        """Stop the car's thread and leave the bus."""
        self._leave.set()
        if self._thread is not None:
            self._thread.join()
        self._session.close()
        if self._session.failure is not None:
            raise self._session.failure


def build_virtual_car(
    bus: BusSettings, settings: CarSettings, plant: "Plant | None" = None
) -> VirtualCar:
    """Compile (or fetch from the cache) and settle the car, and open its end of the bus.

    `plant` replaces the one that the settings name.

    Raises:
        MissingExtraError: the simulation's or the plant's dependencies are not installed.
        ConfigError: there is no such scenario or plant.
        BusError: the bus cannot be opened.
    """
    with needs_extra("sim", "--bus virtual brings its own car, which"):
        from sim_bridge.session import open_session
    session = open_session(
        bus.interface, bus.channel, bus.bitrate, {}, settings.scenario, plant=plant or settings
    )
    return VirtualCar(session, CAR_PRIORITY)
