"""One run of the bridge from bus to bus: what the command line and the virtual car both open."""

from collections.abc import Callable, Mapping

import can

from rt_controller.bus.inbox import CommandInbox
from rt_controller.bus.outbox import VehicleOutbox
from rt_controller.bus.recorder import Recorder
from rt_controller.bus.transport import Option, close_bus, open_bus
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import NEUTRAL_INPUT
from rt_controller.realtime.clock import Clock
from rt_controller.realtime.scheduling import rank_thread
from sim_bridge.adapters.plants import PlantChoice, open_plant
from sim_bridge.bridge import Bridge
from sim_bridge.car import Car
from sim_bridge.scenario import Scenario, load_scenario

OWN_CAR = PlantChoice()


class BridgeSession:
    """A bus that is open, a car that is settled, and the bridge between them."""

    def __init__(self, bus: can.BusABC, bridge: Bridge, recorder: Recorder | None) -> None:
        self._bus = bus
        self._recorder = recorder
        self.bridge = bridge
        self.failure: BaseException | None = None
        """what ended `run` before its time; a thread has nobody to raise it to"""

    def tick(self, now_ns: int) -> None:
        """One period, in lockstep with whoever calls."""
        self.bridge.tick(now_ns)

    def run(self, clock: Clock, should_stop: Callable[[], bool], priority: int) -> None:
        """Tick on `clock` until the mission is over or `should_stop`.

        The thread asks for SCHED_FIFO at `priority`: a car that comes late is a fault that no real
        one has.
        """
        try:
            rank_thread(priority)
            while not should_stop() and not self.bridge.is_over:
                clock.wait()
                self.bridge.tick(clock.now_ns())
        except BaseException as error:
            self.failure = error

    def close(self) -> None:
        """Leave the bus, finish the log and let the plant go."""
        close_bus(self._bus)
        self.bridge.close()
        if self._recorder is not None:
            self._recorder.close()


def build_car(scenario: Scenario, choice: PlantChoice = OWN_CAR) -> Car:
    """The chosen plant at the scenario's speed on its road; compiles what has to be.

    Raises:
        MissingExtraError: the plant's optional dependencies are not installed.
        ConfigError: the plant is not there, or cannot drive even one period.
    """
    plant = open_plant(choice, scenario.road_friction)
    try:
        car = Car(plant, scenario.speed_mps)
        # One period thrown away: what is not compiled or loaded yet is so here and not in the loop.
        car.advance(NEUTRAL_INPUT, scenario.curvature_per_m)
        if plant.failure is not None:
            raise ConfigError(
                f"Expected a plant that drives a first period of 25 ms, found a failure of "
                f"{plant.failure}. Correct the plant or its mapping."
            )
        car.reset(scenario.speed_mps, 0.0, 0.0)
    except BaseException:
        plant.close()
        raise
    return car


def open_session(
    interface: str,
    channel: str,
    bitrate: int | None,
    options: Mapping[str, Option],
    scenario: str,
    recorder: Recorder | None = None,
    plant: PlantChoice = OWN_CAR,
) -> BridgeSession:
    """Everything opened and ready to tick.

    Raises:
        MissingExtraError: the plant's optional dependencies are not installed.
        ConfigError: there is no such scenario or plant.
        BusError: the bus cannot be opened.
    """
    manoeuvre = load_scenario(scenario)
    car = build_car(manoeuvre, plant)
    try:
        bus = open_bus(interface, channel, bitrate, options)
    except BaseException:
        car.close()
        raise
    bridge = Bridge(
        bus=bus,
        inbox=CommandInbox(recorder),
        outbox=VehicleOutbox(bus, recorder),
        car=car,
        scenario=manoeuvre,
    )
    return BridgeSession(bus, bridge, recorder)
