"""Settings of bus and car, which both programs share."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

from pydantic import PositiveInt, ValidationInfo, field_validator

from rt_controller.contract.limits import LEAST_FRICTION, MOST_FRICTION
from rt_controller.contract.names import name_or
from rt_controller.settings_table import Settings

if TYPE_CHECKING:
    import can

VIRTUAL = "virtual"
SharedInterface = Literal["local", "socketcan", "remote", "slcan", "pcan", "kvaser", "vector"]
"""interfaces that join processes"""
CommonInterface = Literal["virtual", SharedInterface]
ShippedScenario = Literal["double_lane_change", "lane_change_60", "lane_change_120", "straight"]
ShippedCar = Literal["c_class_150kw_awd", "c_class_125kw_fwd", "commonroad_vehicle_2"]
OWN, FMU, COMMONROAD = "own", "fmu", "commonroad"
CAR_PRIORITY = 40
"""SCHED_FIFO priority of the car's thread, below the controller's"""


class BusSettings(Settings):
    """Which CAN bus."""

    bus: CommonInterface | str
    """python-can interface, these or another; virtual stays in one process, in which rt-controller
    simulates the car"""
    channel: str = "rt-controller"
    """the interface's channel, e.g. can0 or ws://127.0.0.1:54701/"""
    bitrate: PositiveInt | None = None
    """bit/s, where the interface sets it"""
    bus_option: dict[str, str] | None = None
    """further options of the interface, as --bus-option.KEY VALUE"""

    @field_validator("bus_option", mode="before")
    @classmethod
    def _require_keys(cls, found: object) -> object:
        if not isinstance(found, Mapping | None):
            raise ValueError("expected a value for each key, written --bus-option.KEY VALUE")
        return found

    def open_bus(self) -> "can.BusABC":
        """The open bus.

        Raises:
            ConfigError, MissingExtraError, BusError: as `rt_controller.bus.transport.open_bus`.
        """
        from rt_controller.bus.transport import open_bus, parse_options

        return open_bus(self.bus, self.channel, self.bitrate, parse_options(self.bus_option or {}))


class CarSettings(Settings):
    """The car at the other end of the bus and its manoeuvre."""

    scenario: ShippedScenario | str = "double_lane_change"
    """a shipped manoeuvre, or the path of a .toml file"""
    plant: str = "own"
    """own, fmu:FILE.fmu (FMI 2 or 3 co-simulation) or commonroad:NUMBER"""
    plant_mapping: Path | None = None
    """which variable of the FMU is which signal; default: FILE.toml beside FILE.fmu"""
    car: ShippedCar | str | None = None
    """parameters of the own car: a shipped name, or the path of a .toml file"""
    friction: float | None = None
    """of the road, 1 being the road of the tyre test; default: the scenario's"""
    friction_right: float | None = None
    """of the road under the own car's right wheels; default: as under the left ones"""

    @field_validator("scenario", "car")
    @classmethod
    def _require_shipped_or_file(cls, found: str | None, info: ValidationInfo) -> str | None:
        shipped = get_args(ShippedScenario if info.field_name == "scenario" else ShippedCar)
        if found is None or found in shipped:
            return found
        if not (found.endswith(".toml") and Path(found).is_file()):
            raise ValueError(name_or(found, shipped, "the path of a .toml file that exists"))
        return found

    @field_validator("plant")
    @classmethod
    def _require_kind_of_plant(cls, found: str) -> str:
        kind, _, what = found.partition(":")
        if kind not in (OWN, FMU, COMMONROAD) or (kind == OWN) == bool(what):
            raise ValueError("expected own, fmu:FILE.fmu or commonroad:NUMBER")
        return found

    @field_validator("friction", "friction_right")
    @classmethod
    def _require_friction(cls, found: float | None) -> float | None:
        if found is not None and not LEAST_FRICTION <= found <= MOST_FRICTION:
            raise ValueError(
                f"expected {LEAST_FRICTION} to {MOST_FRICTION}, 1 being the road of the tyre "
                f"test (dry asphalt is about 0.85, packed snow 0.3)"
            )
        return found
