"""`open_plant`: the plant that the options of the command line choose."""

from pathlib import Path

from rt_controller.contract.errors import ConfigError
from rt_controller.model.artifact import find_model, load_bundle
from rt_controller.settings import COMMONROAD, FMU, MODEL, OWN, CarSettings
from sim_bridge.plant.parts import NO_PAYLOAD, Payload
from sim_bridge.plant.protocol import Plant, RoadAt


def open_plant(settings: CarSettings, start: RoadAt, payload: Payload = NO_PAYLOAD) -> Plant:
    """The chosen plant; its options are checked, it has not been reset.

    Args:
        settings: the choice.
        start: ground and air of the scenario on which the own car settles in a reset; the other
            plants have its friction under the left wheels, or that of the settings.
        payload: of the scenario; only the own car takes one.

    Raises:
        MissingExtraError: its optional dependencies are not installed.
        ArtifactError: a bundle cannot be loaded.
        ConfigError: there is no such file, bundle or vehicle, or an option does not apply to the
            plant.
    """
    kind, _, what = settings.plant.partition(":")
    for setting, value, owners in (
        ("plant_mapping", settings.plant_mapping, (FMU,)),
        ("car", settings.car, (OWN,)),
        ("friction", settings.friction, (OWN, FMU, COMMONROAD)),
        ("friction_right", settings.friction_right, (OWN, FMU)),
    ):
        if value is not None and kind not in owners:
            raise ConfigError(
                f"`{setting}`: expected `plant` {' or '.join(owners)}, found {settings.plant}. "
                f"It does not apply to that plant; leave it out."
            )
    if payload.mass_kg > 0.0 and kind != OWN:
        raise ConfigError(
            f"payload: expected --plant {OWN} for a scenario with a payload, found --plant "
            f"{settings.plant}. Leave the payload out of the scenario."
        )
    friction = start.friction_left if settings.friction is None else settings.friction
    if kind == FMU:
        from sim_bridge.adapters.fmu import FmuPlant

        fmu = FmuPlant(Path(what), settings.plant_mapping, friction, settings.friction_right)
        for setting in ("friction", "friction_right"):
            if getattr(settings, setting) is not None and f"road_{setting}" not in fmu.start_fields:
                fmu.close()
                raise ConfigError(
                    f"`{setting}`: expected an FMU whose mapping names start.road_{setting}, found "
                    f"{settings.plant} without. Leave it out: the FMU has its own road."
                )
        return fmu
    if kind == COMMONROAD:
        from sim_bridge.adapters.commonroad import VEHICLES, CommonRoadPlant

        if what not in VEHICLES:
            raise ConfigError(
                f"`plant` commonroad:{what}: expected a vehicle with a multi-body model, "
                f"{', '.join(VEHICLES)}, found {what!r}. Try commonroad:2."
            )
        return CommonRoadPlant(int(what), friction)
    if kind == MODEL:
        from sim_bridge.adapters.learned_car import LearnedCar

        return LearnedCar(load_bundle(find_model(what)), settings.plant)
    from sim_bridge.adapters.own_car import OwnCar, ground_at
    from sim_bridge.plant import parameters as cars
    from sim_bridge.plant.shipped_cars import DEFAULT_CAR

    car = settings.car or DEFAULT_CAR
    parameters = cars.with_payload(cars.load_parameters(car), payload)
    return OwnCar(cars.with_road(parameters, ground_at(start)), car)
