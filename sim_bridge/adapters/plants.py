"""`open_plant`: the plant that the options of the command line choose."""

from pathlib import Path

from rt_controller.contract.errors import ConfigError
from rt_controller.settings import COMMONROAD, FMU, OWN, CarSettings
from sim_bridge.plant.protocol import Plant


def open_plant(settings: CarSettings, road_friction: float) -> Plant:
    """The chosen plant; its options are checked, it has not been reset.

    Args:
        road_friction: of the scenario; 1 is the road of the tyre test.

    Raises:
        MissingExtraError: its optional dependencies are not installed.
        ConfigError: there is no such file or vehicle, or an option does not apply to the plant.
    """
    kind, _, what = settings.plant.partition(":")
    _require_options_apply(settings, kind)
    friction = road_friction if settings.friction is None else settings.friction
    if kind == FMU:
        from sim_bridge.adapters.fmu import open_fmu_plant

        fmu = open_fmu_plant(Path(what), settings.plant_mapping, friction)
        if settings.friction is not None and not fmu.takes_road_friction:
            fmu.close()
            raise ConfigError(
                f"`friction`: expected an FMU whose mapping names start.road_friction, found "
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
    from sim_bridge.adapters.own_car import OwnCar
    from sim_bridge.plant.parameters import DEFAULT_CAR, load_parameters, with_road_friction

    car = settings.car or DEFAULT_CAR
    return OwnCar(with_road_friction(load_parameters(car), friction, settings.friction_right), car)


def _require_options_apply(settings: CarSettings, kind: str) -> None:
    for setting, value, owner in (
        ("plant_mapping", settings.plant_mapping, FMU),
        ("car", settings.car, OWN),
        ("friction_right", settings.friction_right, OWN),
    ):
        if value is not None and kind != owner:
            raise ConfigError(
                f"`{setting}`: expected `plant` {owner}, found {settings.plant}. It "
                f"applies to that plant only; leave it out."
            )
