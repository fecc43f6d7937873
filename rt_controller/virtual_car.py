"""The simulated car on a virtual bus in the process of the controller.

The only module of the controller that imports the simulation, and only when it is asked for; the
program in a vehicle does not use it.
"""

from typing import TYPE_CHECKING

from rt_controller.contract.errors import needs_extra
from rt_controller.settings import BusSettings, CarSettings

if TYPE_CHECKING:
    from sim_bridge.plant.protocol import Plant
    from sim_bridge.session import BridgeSession


def open_virtual_car(
    bus: BusSettings, settings: CarSettings, plant: "Plant | None" = None
) -> "BridgeSession":
    """Compile (or fetch from the cache) and settle the car, and open its end of the bus.

    `plant` replaces the one that the settings name.

    Raises:
        MissingExtraError: the simulation's or the plant's dependencies are not installed.
        ConfigError: there is no such scenario or plant.
        PlantError: the plant raised an exception in its reset or first step.
        BusError: the bus cannot be opened.
    """
    with needs_extra("sim", "The simulated car"):
        from sim_bridge.session import open_session
    return open_session(bus, settings.scenario, plant=plant or settings)
