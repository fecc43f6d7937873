"""`open_plant`: the plant that the options of the command line choose."""

from pathlib import Path
from typing import TYPE_CHECKING

from rt_controller.car_settings import CarSettings
from rt_controller.contract.errors import ConfigError
from sim_bridge.plant.protocol import Plant

if TYPE_CHECKING:
    from sim_bridge.plant.parameters import Parameters

DEFAULT_CAR = "c_class_150kw_awd"
OWN = "own"
FMU = "fmu"
COMMONROAD = "commonroad"
_LEAST_FRICTION, _MOST_FRICTION = 0.05, 1.5


def open_plant(settings: CarSettings, road_friction: float) -> Plant:
    """The chosen plant; its options are checked, it has not been reset.

    Args:
        road_friction: of the scenario; 1 is the road of the tyre test.

    Raises:
        MissingExtraError: its optional dependencies are not installed.
        ConfigError: there is no such plant, or an option does not apply to it.
    """
    kind, _, what = settings.plant.partition(":")
    if kind not in (OWN, FMU, COMMONROAD) or (kind == OWN) == bool(what):
        raise ConfigError(
            f"--plant {settings.plant}: expected own, fmu:FILE.fmu or commonroad:NUMBER, found "
            f"{settings.plant!r}."
        )
    _require_options_apply(settings, kind)
    friction = road_friction if settings.friction is None else settings.friction
    _require_friction("--friction", friction)
    _require_friction("--friction-right", settings.friction_right)
    if kind == FMU:
        from sim_bridge.adapters.fmu import open_fmu_plant

        fmu = open_fmu_plant(Path(what), settings.plant_mapping, friction)
        if settings.friction is not None and not fmu.takes_road_friction:
            fmu.close()
            raise ConfigError(
                f"--friction: expected an FMU whose mapping names start.road_friction, found "
                f"{settings.plant} without. Leave the option out: the FMU has its own road."
            )
        return fmu
    if kind == COMMONROAD:
        from sim_bridge.adapters.commonroad import VEHICLES, CommonRoadPlant

        if what not in VEHICLES:
            raise ConfigError(
                f"--plant commonroad:{what}: expected a vehicle with a multi-body model, "
                f"{', '.join(VEHICLES)}, found {what!r}. Try commonroad:2."
            )
        return CommonRoadPlant(int(what), friction)
    from sim_bridge.adapters.own_car import OwnCar

    car = settings.car or DEFAULT_CAR
    return OwnCar(own_parameters(car, friction, settings.friction_right), car)


def own_parameters(car: str, friction: float, friction_right: float | None) -> "Parameters":
    """The own car's parameters on a road of that friction; by name or .toml file.

    Raises:
        ConfigError: there is no such car, or no such road.
    """
    from sim_bridge.plant.parameters import load_parameters, with_road_friction

    return with_road_friction(load_parameters(car), friction, friction_right)


def _require_options_apply(settings: CarSettings, kind: str) -> None:
    for option, value, owner in (
        ("--plant-mapping", settings.plant_mapping, FMU),
        ("--car", settings.car, OWN),
        ("--friction-right", settings.friction_right, OWN),
    ):
        if value is not None and kind != owner:
            raise ConfigError(
                f"{option}: expected --plant {owner}, found --plant {settings.plant}. It "
                f"applies to that plant only; leave it out."
            )


def _require_friction(option: str, friction: float | None) -> None:
    if friction is not None and not _LEAST_FRICTION <= friction <= _MOST_FRICTION:
        raise ConfigError(
            f"{option}: expected {_LEAST_FRICTION}..{_MOST_FRICTION}, 1 for the road of the "
            f"tyre test, found {friction}. Dry asphalt is about 0.85, packed snow 0.3."
        )
