"""Settings of bus and car, which both programs share."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, get_args

from pydantic import Field, PositiveInt, field_validator

from rt_controller.contract.limits import LEAST_FRICTION, MOST_FRICTION
from rt_controller.contract.names import name_or, split_roads
from rt_controller.settings_table import Settings

if TYPE_CHECKING:
    import can

VIRTUAL = "virtual"
SharedInterface = Literal["local", "socketcan", "remote", "slcan", "pcan", "kvaser", "vector"]
"""interfaces that join processes"""
CommonInterface = Literal["virtual", SharedInterface]
ShippedScenario = Literal[
    "corner",
    "curvature_step",
    "double_lane_change",
    "iso_3888_1",
    "iso_3888_2",
    "lane_change_60",
    "lane_change_120",
    "launch_50",
    "road_course",
    "sine_60",
    "sine_110",
    "slalom",
    "split_friction",
    "stop_and_go",
    "stop_and_hold",
    "straight",
    "u_turn",
]
ShippedCar = Literal[
    "c_class_150kw_awd", "c_class_125kw_fwd", "c_class_150kw_bev", "commonroad_vehicle_2"
]
OWN, FMU, COMMONROAD, MODEL = "own", "fmu", "commonroad", "model"
SCENARIO_SUFFIXES = (".toml", ".xodr")
"""of scenarios of this project and OpenDRIVE maps"""
CAR_PRIORITY = 40
"""SCHED_FIFO priority of the car's thread, below the controller's"""


def _require_shipped(found: str, shipped: tuple[str, ...], otherwise: str) -> None:
    if found not in shipped:
        raise ValueError(name_or(found, shipped, otherwise))


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

    def open_bus(self, is_fd: bool = False) -> "can.BusABC":
        """The open bus; `is_fd`: for frames of CAN FD too, which a car may send.

        Raises:
            ConfigError, MissingExtraError, BusError: as `rt_controller.bus.transport.open_bus`.
        """
        from can.util import cast_from_string

        from rt_controller.bus.transport import open_bus

        written = self.bus_option or {}
        options = {name: cast_from_string(value) for name, value in written.items()}
        return open_bus(self.bus, self.channel, self.bitrate, options, is_fd)

    def require_openable(self, is_fd: bool = False) -> None:
        """Return if the bus opens here: it is opened and closed, before work that takes longer.

        Raises:
            ConfigError, MissingExtraError, BusError: as `open_bus`.
        """
        from rt_controller.bus.transport import close_bus

        # An adapter on a serial port gets two seconds to start where it is used.
        quick = {"sleep_after_open": "0"} if self.bus == "slcan" else {}
        tried = self.model_copy(update={"bus_option": {**(self.bus_option or {}), **quick}})
        close_bus(tried.open_bus(is_fd))


class CarSettings(Settings):
    """The car at the other end of the bus and its manoeuvre."""

    scenario: ShippedScenario | str = "double_lane_change"
    """a shipped manoeuvre, or the path of a .toml file or an OpenDRIVE map (map.xodr#ROAD,ROAD)"""
    plant: str = "own"
    """own, fmu:FILE.fmu (FMI 2 or 3 co-simulation), commonroad:NUMBER, or model:BUNDLE: the car as
    a model has learned it"""
    plant_mapping: Path | None = None
    """which variable of the FMU is which signal; default: FILE.toml beside FILE.fmu"""
    car: ShippedCar | str | None = None
    """parameters of the own car: a shipped name, or the path of a .toml file"""
    friction: float | None = None
    """of the road, 1 being the road of the tyre test; default: the scenario's"""
    friction_right: float | None = None
    """of the road under the right wheels (own car, or an FMU); default: as under the left ones"""
    transport_delay: Annotated[int, Field(ge=0, le=3)] = 1
    """periods until the vehicle follows a command: bus and computing"""
    actuation_delay: Annotated[int, Field(ge=0, le=5)] = 1
    """periods from there on until pedals and steering wheel move"""
    faults: Path | None = None
    """faults of bus and actuators, a .toml file; added to those of the scenario"""

    @field_validator("scenario")
    @classmethod
    def _require_scenario(cls, found: str) -> str:
        path = Path(split_roads(found)[0])
        if not (path.suffix.lower() in SCENARIO_SUFFIXES and path.is_file()):
            otherwise = f"the path of a {', '.join(SCENARIO_SUFFIXES)} file that exists"
            _require_shipped(found, get_args(ShippedScenario), otherwise)
        return found

    @field_validator("car")
    @classmethod
    def _require_car(cls, found: str | None) -> str | None:
        if found is not None and not (found.endswith(".toml") and Path(found).is_file()):
            _require_shipped(found, get_args(ShippedCar), "the path of a .toml file that exists")
        return found

    @field_validator("plant")
    @classmethod
    def _require_kind_of_plant(cls, found: str) -> str:
        kind, _, what = found.partition(":")
        if kind not in (OWN, FMU, COMMONROAD, MODEL) or (kind == OWN) == bool(what):
            raise ValueError("expected own, fmu:FILE.fmu, commonroad:NUMBER or model:BUNDLE")
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
