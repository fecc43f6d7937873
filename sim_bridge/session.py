"""One run of the bridge: bus, car and log opened for the command line or the virtual car."""

from contextlib import ExitStack
from math import inf
from pathlib import Path
from threading import Event, Thread

import can

from rt_controller.bus.log.recorder import Recorder
from rt_controller.bus.transport import close_bus
from rt_controller.contract.errors import BusError, ConfigError, PlantError
from rt_controller.contract.signals import NEUTRAL_INPUT
from rt_controller.realtime.clock import RealtimeClock
from rt_controller.realtime.scheduling import set_thread_priority
from rt_controller.settings import BusSettings, CarSettings
from sim_bridge.adapters.plants import open_plant
from sim_bridge.bridge import Bridge, Delay
from sim_bridge.car import Car
from sim_bridge.plant.parts import Payload
from sim_bridge.plant.protocol import Plant, require_plant
from sim_bridge.scenario import Scenario, load_scenario
from sim_bridge.scenario.loading import add_faults
from sim_bridge.scenario_checks import require_road
from sim_bridge.settling import settle

OWN_CAR = CarSettings()
LONGEST_STANDBY_S = 10.0
"""of a controller that simulated time waits for"""
LONGEST_STOP_S = 120.0
"""after the end of the scenario, of a car that simulated time waits for"""


class BridgeSession:
    """An open bus, a settled car, and the bridge between them."""

    def __init__(self, bus: can.BusABC, bridge: Bridge) -> None:
        self._bus = bus
        self._end_request, self._stop_request = Event(), Event()
        self._thread: Thread | None = None
        self.bridge = bridge
        self.failure: BaseException | None = None
        """the exception that ended the thread early: it cannot raise it to its caller"""

    def start(self, priority: int, listening_ticks: int = 0, wait_s: float = inf) -> Thread:
        """Tick in real time until the mission is over or a stop is requested, in a thread.

        Args:
            priority: SCHED_FIFO priority that the thread asks for: a real car is never late.
            listening_ticks: before its first frame; it fails if another vehicle is on the bus.
            wait_s: longest wait for a controller.
        """
        arguments = priority, listening_ticks, wait_s
        self._thread = Thread(target=self._run, args=arguments, name="car")
        self._thread.start()
        return self._thread

    def tick(self, now_ns: int) -> None:
        """Tick in simulated time, which starts at 0.

        Raises:
            BusError: see `Bridge.tick`; or no controller drove the car for `LONGEST_STANDBY_S`.
            PlantError: the car still moves `LONGEST_STOP_S` after the end of the scenario.
        """
        bridge = self.bridge
        bridge.tick(now_ns)
        if bridge.run.time_s > bridge.scenario.duration_s + LONGEST_STOP_S:
            raise PlantError(
                f"Expected a car at rest within {LONGEST_STOP_S:g} s after the end of the "
                f"scenario, found {bridge.summary().final_speed_mps:.2g} m/s with the brake of a "
                f"safe stop. Check the brake of the plant and the grade of the road."
            )
        if bridge.is_waiting and now_ns > LONGEST_STANDBY_S * 1e9:
            raise BusError(
                f"Expected a controller that drives the car within {LONGEST_STANDBY_S:g} s of "
                f"simulated time, found one that stays in STANDBY. The initial pose and speed of "
                f"the scenario have to be such that the controller finds a plan."
            )

    @property
    def is_stop_requested(self) -> bool:
        """True if the mission was requested to end."""
        return self._end_request.is_set()

    def request_stop(self) -> None:
        """Request the end of the mission; the second time, the end of the thread after its tick.

        The controller receives the end of the mission and releases the car. Without one there is
        no mission, and the first request ends the thread.
        """
        if self._end_request.is_set() or self.bridge.is_waiting:
            self._stop_request.set()
        self._end_request.set()

    def close(self) -> None:
        """End the thread and close bus and plant.

        Raises:
            BaseException: the one that ended the thread.
        """
        self._stop_request.set()
        if self._thread is not None:
            self._thread.join()
        close_bus(self._bus)
        self.bridge.close()
        if self.failure is not None:
            raise self.failure

    def _run(self, priority: int, listening_ticks: int, wait_s: float) -> None:
        clock = RealtimeClock()
        wait_until_s = clock.now_ns() * 1e-9 + wait_s
        try:
            set_thread_priority(priority)
            for _ in range(listening_ticks):
                clock.wait()
                self.bridge.listen(clock.now_ns())
            while not self._stop_request.is_set() and not self.bridge.is_over:
                clock.wait()
                if self.is_stop_requested:
                    self.bridge.end_mission()
                now_ns = clock.now_ns()
                if self.bridge.is_waiting and now_ns * 1e-9 > wait_until_s:
                    return
                self.bridge.tick(now_ns)
        except BaseException as error:
            self.failure = error


def build_car(scenario: Scenario, choice: CarSettings | Plant = OWN_CAR) -> Car:
    """The chosen plant at the scenario's speed on its road, its library loaded.

    Raises:
        MissingExtraError: the plant's optional dependencies are not installed.
        ConfigError: the plant does not exist, or cannot drive one period.
        PlantError: the plant raised an exception in its reset or first step.
    """
    plant, start = choice, scenario.start
    ground = scenario.road_at(start.s_m, 0.0)
    if isinstance(plant, CarSettings):
        payload = Payload(*(value for _, value in scenario.payload))
        plant = open_plant(plant, ground, payload)
    else:
        require_plant(plant)
    with ExitStack() as opened:
        opened.callback(plant.close)
        require_road(plant, scenario)
        car = Car(plant, start.speed_mps)
        # One period for nothing: what is loaded at first use is loaded here and not in the loop.
        car.set_road(ground)
        car.advance(NEUTRAL_INPUT, scenario.road.curvature_per_m)
        if plant.failure is not None:
            raise ConfigError(
                f"Expected a plant that drives a first control period, found a failure of "
                f"{plant.failure}. Correct the plant or its mapping."
            )
        settle(car, start, ground)
        opened.pop_all()
    return car


def open_session(
    bus_settings: BusSettings,
    scenario: str | Scenario,
    recorder: Recorder | None = None,
    plant: CarSettings | Plant = OWN_CAR,
    faults: Path | None = None,
    has_checks: bool = True,
    signals: Path | None = None,
) -> BridgeSession:
    """A session with everything opened and ready to tick; `faults` is a file of them.

    The caller closes the recorder, after the session. `has_checks` is that of `Bridge`; `signals`
    is the mapping file of a car whose messages the simulated one has on the bus.

    Raises:
        MissingExtraError: the plant's optional dependencies are not installed.
        ConfigError: there is no such scenario, plant or file of faults, or the plant cannot drive
            one period.
        PlantError: the plant raised an exception in its reset or first step.
        BusError: the bus cannot be opened.
    """
    manoeuvre = load_scenario(scenario) if isinstance(scenario, str) else scenario
    settings = plant if isinstance(plant, CarSettings) else OWN_CAR
    manoeuvre = manoeuvre.with_friction(settings.friction, settings.friction_right)
    if faults is not None:
        manoeuvre = add_faults(manoeuvre, faults)
    car = build_car(manoeuvre, plant)
    with ExitStack() as opened:
        opened.callback(car.plant.close)
        if signals is None:
            bus = bus_settings.open_bus()
        else:
            from rt_controller.mapping.car_file import read_car
            from sim_bridge.foreign_bus import ForeignBus, require_same_road

            foreign = read_car(signals)
            require_same_road(foreign, manoeuvre)
            below = bus_settings.open_bus(foreign.database.is_fd)
            opened.callback(close_bus, below)
            bus = ForeignBus(below, foreign, lambda: car.s_m)
        opened.pop_all()
    delay = Delay(settings.transport_delay, settings.actuation_delay)
    bridge = Bridge(bus, car, manoeuvre, recorder, delay, has_checks)
    return BridgeSession(bus, bridge)
