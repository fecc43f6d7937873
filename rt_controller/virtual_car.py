"""The simulated car on a virtual bus in the process of the controller.

The only module of the controller that imports the simulation, and only when it is asked for; the
program in a vehicle does not use it.
"""

from typing import TYPE_CHECKING

from rt_controller.contract.errors import require_type
from rt_controller.contract.steering_geometry import SteeringGeometry
from rt_controller.drive.car_figures import LateralError
from rt_controller.drive.scenario import ConeAt, DrivenScenario, LaneAt
from rt_controller.settings import BusSettings, CarSettings

if TYPE_CHECKING:
    from sim_bridge.plant.protocol import Plant
    from sim_bridge.scenario import Scenario
    from sim_bridge.session import BridgeSession


def open_virtual_car(
    bus: BusSettings,
    settings: CarSettings,
    plant: "Plant | None" = None,
    scenario: "Scenario | None" = None,
) -> "BridgeSession":
    """Settle the car, and open its end of the bus.

    `plant` and `scenario` replace those that the settings name.

    Raises:
        MissingExtraError: the car is not compiled, or the plant's dependencies are not installed.
        ConfigError: there is no such scenario or plant.
        PlantError: the plant raised an exception in its reset or first step.
        BusError: the bus cannot be opened.
    """
    from sim_bridge.session import open_session

    return open_session(
        bus, scenario or settings.scenario, plant=plant or settings, faults=settings.faults
    )


def driven_scenario(car: "BridgeSession") -> DrivenScenario:
    """What the car of a session drives."""
    scenario, course = car.bridge.scenario, car.bridge.scenario.course
    return DrivenScenario(
        name=scenario.name,
        plant=car.bridge.plant_name,
        friction=scenario.road.uniform_friction,
        start_s_m=scenario.start.s_m,
        cones=tuple(ConeAt(*cone) for cone in course.cones),
        lanes=tuple(LaneAt(*lane) for lane in course.lanes),
    )


def car_error(car: "BridgeSession") -> LateralError:
    """Lateral error of the car of a session so far, as the simulation has it."""
    summary = car.bridge.summary()
    return LateralError(summary.ey_rms_m, summary.ey_peak_m)


def steering_note(car: "BridgeSession", geometry: SteeringGeometry) -> str | None:
    """A sentence if the scenario needs more steering than the controller may command."""
    from sim_bridge.scenario_checks import steering_note as note

    return note(car.bridge.scenario, geometry)


def grip_note(car: "BridgeSession", friction: float | None) -> str | None:
    """A sentence if the scenario needs more grip than this friction gives, if one is set."""
    if friction is None:
        return None
    from sim_bridge.scenario_checks import grip_note as note

    return note(car.bridge.scenario)


def require_scenario(found: object) -> None:
    """Return if an argument is a `Scenario`.

    Raises:
        TypeError: it is not.
    """
    from sim_bridge.scenario import Scenario

    expected = "the name or path of a scenario, or a sim_bridge.Scenario"
    require_type("scenario", found, Scenario, expected)
