"""The options of `rt-controller`, as one model: what is refused is refused all at once."""

import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from cyclopts.config import Toml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rt_controller.car_settings import CarSettings
from rt_controller.config import (
    BusSettings,
    ControllerConfig,
    MpcSettings,
    Pace,
    RealtimeSettings,
)
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.settings_errors import Location, dotted, explain
from rt_controller.terminal.bus_options import BusOptions

VIRTUAL = "virtual"
_Duration = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class RunOptions(CarSettings, BusOptions):
    """Options of one run; those of `CarSettings` are for `--bus virtual` only."""

    model: str | None = None
    """shipped model (mdk-net, mdk-net-paper, lti) or folder of a bundle, ./lti for a folder with
    the name of a shipped one; default: mdk-net"""
    pace: Pace = Pace.REALTIME
    """realtime, or lockstep: as fast as possible and the same frames every time (virtual only)"""
    duration_s: _Duration | None = None
    """bring the car to rest and leave after this time"""
    stay: bool = False
    """stay on the bus when a mission ends, and wait for the next"""
    wait_s: _Duration = 30.0
    """longest wait for the vehicle"""
    mpc: MpcSettings = MpcSettings()
    realtime: RealtimeSettings = RealtimeSettings()
    max_misses: Annotated[int, Field(ge=0)] | None = None
    """deadline misses that still end with exit code 0; default: 2 % of the ticks on the virtual
    bus, none on any other"""
    record: Path | None = None
    """write all frames to this candump log"""
    json_file: Annotated[Path | None, Parameter(name="--json")] = Field(None, alias="json")
    """write the summary to this JSON file"""
    plot: Path | None = None
    """draw the drive into this file: .png, .svg or .pdf"""
    ticks: Path | None = None
    """write the times of every tick of the last hour to this CSV file"""
    check: bool = False
    """open and check everything, then leave without driving"""
    quiet: bool = False
    """no live line"""

    model_config = ConfigDict(populate_by_name=True)

    @property
    def is_virtual(self) -> bool:
        """True if the simulated car drives in this process."""
        return self.bus == VIRTUAL

    def controller(self) -> ControllerConfig:
        """The part that the controller is built from."""
        # Simulated time needs no rank among the threads of this machine.
        is_lockstep = self.pace is Pace.LOCKSTEP
        realtime = self.realtime.model_copy(update={"priority": 0} if is_lockstep else {})
        return ControllerConfig(
            bus=BusSettings(
                interface=self.bus,
                channel=self.channel,
                bitrate=self.bitrate,
                options=self.bus_option,
            ),
            model=self.model,
            mpc=self.mpc,
            realtime=realtime,
        )

    def require_consistent(self) -> None:
        """Return if the options fit each other.

        Raises:
            ConfigError: an option of the simulated car without `--bus virtual`.
        """
        if self.is_virtual:
            return
        if self.pace is Pace.LOCKSTEP:
            raise ConfigError(
                f"--pace lockstep: expected --bus virtual, found {self.bus!r}. Only a car in this "
                f"process can wait for the controller."
            )
        changed = [name for name in CarSettings.model_fields if name in self.model_fields_set]
        if changed:
            raise ConfigError(
                f"--{changed[0].replace('_', '-')}: expected --bus virtual, found {self.bus!r}. On "
                f"another bus the car is chosen where sim-bridge is started."
            )


def read_config_file(path: Path) -> Toml:
    """The settings of a TOML file, as a source for cyclopts.

    Raises:
        ConfigError: no such file, no TOML, or settings that are refused: each by its name.
    """
    try:
        settings = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(
            f"--config {path}: expected a TOML file, found {error.strerror}."
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"--config {path}: expected a TOML file in UTF-8, found: {error}."
        ) from error
    settings = _with_underscores(settings)
    try:
        RunOptions.model_validate({"bus": VIRTUAL, **settings})
    except ValidationError as error:
        raise ConfigError(f"--config {path}:\n{explain(error, dotted, _fields_in)}") from error
    return Toml(path, must_exist=True)


def _with_underscores(table: Any) -> Any:
    """The table with its keys as in Python: a file may write ey-m for ey_m, as options do."""
    if not isinstance(table, dict):
        return table
    return {name.replace("-", "_"): _with_underscores(value) for name, value in table.items()}


def _fields_in(place: Location) -> Iterable[str]:
    model: type[BaseModel] = RunOptions
    for part in place:
        annotation = model.model_fields[str(part)].annotation
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return ()
        model = annotation
    return tuple(field.alias or name for name, field in model.model_fields.items())
