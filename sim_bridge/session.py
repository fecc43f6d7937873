"""One run of the bridge: bus, car and log opened for the command line or the virtual car."""

from collections.abc import Callable, Mapping

import can

from rt_controller.bus.inbox import Inbox
from rt_controller.bus.message import Node
from rt_controller.bus.outbox import Outbox
from rt_controller.bus.recorder import Recorder
from rt_controller.bus.transport import Option, close_bus, open_bus
from rt_controller.car_settings import CarSettings
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import NEUTRAL_INPUT
from rt_controller.contract.timing import PERIOD_S
from rt_controller.realtime.clock import Clock
from rt_controller.realtime.scheduling import set_thread_priority
from sim_bridge.adapters.plants import open_plant
from sim_bridge.bridge import Bridge
from sim_bridge.car import Car
from sim_bridge.plant.protocol import Plant, require_motion, require_plant
from sim_bridge.scenario import Scenario, load_scenario

OWN_CAR = CarSettings()


class BridgeSession:
    """An open bus, a settled car, and the bridge between them."""

    def __init__(self, bus: can.BusABC, bridge: Bridge, recorder: Recorder | None) -> None:
        self._bus = bus
        self._recorder = recorder
        self.bridge = bridge
        self.failure: BaseException | None = None
        """the exception that ended `run` early: a thread cannot raise it to its caller"""

    def run(self, clock: Clock, should_stop: Callable[[], bool], priority: int) -> None:
        """Tick on `clock` until the mission is over or `should_stop`.

        The thread asks for SCHED_FIFO at `priority`: a real car is never late.
        """
        try:
            set_thread_priority(priority)
            while not should_stop() and not self.bridge.is_over:
                clock.wait()
                self.bridge.tick(clock.now_ns())
        except BaseException as error:
            self.failure = error

    def close(self) -> None:
        """Leave the bus, finish the log and close the plant."""
        close_bus(self._bus)
        self.bridge.close()
        if self._recorder is not None:
            self._recorder.close()


def build_car(scenario: Scenario, choice: CarSettings | Plant = OWN_CAR) -> Car:
    """The chosen plant at the scenario's speed on its road; its kernels are compiled.

    Raises:
        MissingExtraError: the plant's optional dependencies are not installed.
        ConfigError: the plant does not exist, or cannot drive one period.
    """
    plant = choice
    if isinstance(plant, CarSettings):
        plant = open_plant(plant, scenario.road_friction)
    else:
        require_plant(plant)
        require_motion(plant.reset(scenario.speed_mps), (3,), "reset")
        require_motion(plant.step(NEUTRAL_INPUT, PERIOD_S), (None, 3), "step")
    try:
        car = Car(plant, scenario.speed_mps)
        # One period for nothing: what is not compiled or loaded yet is so here and not in the loop.
        car.advance(NEUTRAL_INPUT, scenario.curvature_per_m)
        if plant.failure is not None:
            raise ConfigError(
                f"Expected a plant that drives a first control period, found a failure of "
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
    plant: CarSettings | Plant = OWN_CAR,
) -> BridgeSession:
    """A session with everything opened and ready to tick.

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
        car.plant.close()
        raise
    bridge = Bridge(
        bus=bus,
        inbox=Inbox(Node.VEHICLE, recorder),
        outbox=Outbox(bus, Node.VEHICLE, recorder),
        car=car,
        scenario=manoeuvre,
    )
    return BridgeSession(bus, bridge, recorder)
