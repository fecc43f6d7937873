"""Which plant drives: the choice that a person makes on the command line, opened."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rt_controller.contract.errors import ConfigError
from sim_bridge.plant.protocol import Plant

if TYPE_CHECKING:
    from sim_bridge.plant.parameters import Parameters

DEFAULT_CAR = "c_class_150kw_awd"
OWN = "own"
FMU = "fmu"
COMMONROAD = "commonroad"
_LEAST_FRICTION, _MOST_FRICTION = 0.05, 1.5


@dataclass(frozen=True, slots=True)
class PlantChoice:
    """What to put behind the bridge, and on which ground."""

    plant: str = OWN
    """own, fmu:FILE.fmu or commonroad:NUMBER"""
    mapping: Path | None = None
    """of an FMU's variables; None: the file beside the FMU"""
    car: str | None = None
    """of the own car: the name of a shipped one, or a .toml file"""
    friction: float | None = None
    """of the road; None: the scenario's"""
    friction_right: float | None = None
    """under the right wheels of the own car; None: the same"""


def open_plant(choice: PlantChoice, road_friction: float) -> Plant:
    """The chosen plant, checked as far as can be without driving.

    Args:
        road_friction: the scenario's, 1 being the road of the own tyre's test.

    Raises:
        MissingExtraError: its optional dependencies are not installed.
        ConfigError: there is no such plant, or an option that it has no use for.
    """
    kind, _, what = choice.plant.partition(":")
    if kind not in (OWN, FMU, COMMONROAD) or (kind == OWN) == bool(what):
        raise ConfigError(
            f"--plant {choice.plant}: expected own, fmu:FILE.fmu or commonroad:NUMBER, found "
            f"{choice.plant!r}."
        )
    _refuse_useless(choice, kind)
    friction = road_friction if choice.friction is None else choice.friction
    _require_friction("--friction", friction)
    _require_friction("--friction-right", choice.friction_right)
    if kind == FMU:
        from sim_bridge.adapters.fmu import open_fmu_plant

        fmu = open_fmu_plant(Path(what), choice.mapping, friction)
        if choice.friction is not None and not fmu.takes_road_friction:
            fmu.close()
            raise ConfigError(
                f"--friction: expected an FMU whose mapping names start.road_friction, found "
                f"{choice.plant} without. It drives on its own road; leave the option out."
            )
        return fmu
    if kind == COMMONROAD:
        from sim_bridge.adapters.commonroad import CommonRoadPlant

        return CommonRoadPlant(_number(what), friction)
    return _own(choice, friction)


def own_parameters(car: str, friction: float, friction_right: float | None) -> "Parameters":
    """The own car's parameters on a road of that friction; by name or .toml file.

    Raises:
        ConfigError: there is no such car, or no such road.
    """
    from sim_bridge.plant.parameters import load_parameters, with_road_friction

    return with_road_friction(load_parameters(car), friction, friction_right)


def _own(choice: PlantChoice, friction: float) -> Plant:
    from sim_bridge.adapters.own_car import OwnCar

    car = choice.car or DEFAULT_CAR
    return OwnCar(own_parameters(car, friction, choice.friction_right), car)


def _refuse_useless(choice: PlantChoice, kind: str) -> None:
    for option, value, owner in (
        ("--plant-mapping", choice.mapping, FMU),
        ("--car", choice.car, OWN),
        ("--friction-right", choice.friction_right, OWN),
    ):
        if value is not None and kind != owner:
            raise ConfigError(
                f"{option}: expected --plant {owner}, found --plant {choice.plant}. Only that "
                f"plant has a use for it; leave it out."
            )


def _require_friction(option: str, friction: float | None) -> None:
    if friction is not None and not _LEAST_FRICTION <= friction <= _MOST_FRICTION:
        raise ConfigError(
            f"{option}: expected {_LEAST_FRICTION}..{_MOST_FRICTION}, 1 for the road of the "
            f"tyre's test, found {friction}. Dry asphalt is about 0.85, packed snow 0.3."
        )


def _number(what: str) -> int:
    if not what.isdecimal():
        raise ConfigError(
            f"--plant commonroad:{what}: expected the number of a CommonRoad vehicle, found "
            f"{what!r}. Try commonroad:2."
        )
    return int(what)
