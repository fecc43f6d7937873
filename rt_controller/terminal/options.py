"""The options of `rt-controller` and its commands; those of a run are refused all at once."""

import os
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from cyclopts import Parameter
from cyclopts.config import Dict
from pydantic import ConfigDict, Field, PositiveInt, ValidationError, field_validator

from rt_controller.config import ControllerConfig, ShippedModel
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.names import MODEL_FOLDER, name_or
from rt_controller.contract.settings_errors import dotted, explain
from rt_controller.contract.timing import LONGEST_S
from rt_controller.settings import VIRTUAL, BusSettings, CarSettings

_Duration = Annotated[float, Field(gt=0.0, le=LONGEST_S, allow_inf_nan=False)]
_Tick = Annotated[int, Field(ge=0)]
_JsonFile = Annotated[Path | None, Parameter(name="--json")]


@Parameter(name="*")
class RunOptions(ControllerConfig, CarSettings, BusSettings):
    """Options of one run; those of `CarSettings` are for `--bus virtual` only."""

    pace: Literal["realtime", "lockstep"] = "realtime"
    """realtime, or lockstep: as fast as possible and the same frames every time (virtual only)"""
    duration_s: _Duration | None = None
    """request the stop after this time; braking to rest follows and is part of the drive and of its
    figures"""
    stay: bool = False
    """stay on the bus when a mission ends, and wait for the next"""
    wait_s: _Duration = 30.0
    """longest wait for the vehicle"""
    max_misses: Annotated[int, Field(ge=0)] | None = None
    """deadline misses that still end with exit code 0; default: 2 % of the ticks on the virtual
    bus, none on any other"""
    record: Path | None = None
    """write all frames to this candump log (.log), or to a new one in this folder; `replay` and
    `explain` read it with the .journal beside it"""
    overwrite: bool = False
    """replace an existing log of --record, which otherwise is refused"""
    json_file: _JsonFile = Field(None, alias="json")
    """write the summary to this JSON file"""
    plot: Path | None = None
    """draw the drive into this file: .png, .svg or .pdf; .gif is a moving picture from above: the
    whole drive, and below it the road around the car"""
    ticks: Path | None = None
    """write the times of every tick of the last hour to this CSV file"""
    check: bool = False
    """load the model, plan with it, open the bus, then end"""
    quiet: bool = False
    """no progress on stderr; errors and the result remain"""
    verbose: Annotated[bool, Parameter(alias="-v")] = False
    """show the times of the loop, the counts of frames and the real-time settings too"""

    model_config = ConfigDict(populate_by_name=True)

    @field_validator("model")
    @classmethod
    def _require_model(cls, found: str | Path | None) -> str | Path | None:
        shipped = get_args(ShippedModel)
        if found is not None and found not in shipped and not Path(found).exists():
            raise ValueError(name_or(str(found), shipped, MODEL_FOLDER))
        if found not in shipped and (Path(str(found)) / "config.json").is_file():  # of a run
            bundle = Path(str(found)) / "bundle"
            export = f"export it first: offline-export {found}"
            remedy = f"its bundle is {bundle}" if bundle.is_dir() else export
            raise ValueError(f"expected a bundle, found the folder of a run: {remedy}")
        return found

    @property
    def is_virtual(self) -> bool:
        """True if the simulated car drives in this process."""
        return self.bus == VIRTUAL

    @property
    def is_lockstep(self) -> bool:
        """True if time is simulated."""
        return self.pace == "lockstep"

    def require_consistent(self) -> None:
        """Return if the options fit each other.

        Raises:
            ConfigError: an option of the simulated car without `--bus virtual`, or one file for two
                outputs.
        """
        options: dict[str, str] = {}
        for name in ("record", "json_file", "ticks", "plot"):
            path, option = getattr(self, name), f"--{name.removesuffix('_file')}"
            if path is None or (path.exists() and not path.is_file()):  # a folder, a device
                continue
            other = options.setdefault(os.path.realpath(path), option)
            if other != option:
                raise ConfigError(
                    f"{option} {path}: expected a file of its own, found that of {other}. Name "
                    f"another one."
                )
        if self.is_virtual:
            return
        if self.is_lockstep:
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


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class CheckOptions:
    """Options of `signals check`."""

    bus: str | None = None
    """or the python-can interface to listen to"""
    channel: str = "rt-controller"
    """of the interface"""
    bitrate: PositiveInt | None = None
    """in bit/s, where the interface sets it"""
    listen_s: _Duration = 10.0
    """how long to listen"""
    json_file: _JsonFile = None
    """write the report to this JSON file"""
    quiet: bool = False
    """no progress on stderr"""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class GatewayOptions:
    """Options of `signals gateway`."""

    bus: str
    """python-can interface on which rt-controller is"""
    channel: str = "rt-controller"
    """of that interface"""
    bitrate: PositiveInt | None = None
    """of that interface, in bit/s"""
    car_bus: str
    """python-can interface on which the car is"""
    car_channel: str
    """of that interface"""
    car_bitrate: PositiveInt | None = None
    """of that interface, in bit/s"""
    model: str | None = None
    """name or folder of a model, for the estimate of a lateral speed that is not measured"""
    priority: Annotated[int, Field(ge=0, le=99)] = 50
    """SCHED_FIFO priority, where the system allows it; 0: none"""
    json_file: _JsonFile = None
    """write the counts to this JSON file"""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ReplayOptions:
    """Options of `replay`."""

    tick: _Tick | None = None
    """replay up to this tick, from 0, and show it as `explain` does"""
    model: str | Path | None = None
    """another model, to see what it would have commanded; default: the recorded one"""
    mcap: Path | None = None
    """write decoded signals, plan and cause of every replayed tick to this MCAP file"""
    overwrite: bool = False
    """replace an existing file of --mcap"""
    json_file: _JsonFile = None
    """write the result to this JSON file"""
    quiet: bool = False
    """no progress on stderr"""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ExplainOptions:
    """Options of `explain`."""

    tick: _Tick | None = None
    """number of the tick, from 0; default: the one in which the last safe stop began"""
    model: str | Path | None = None
    """another model; default: the recorded one"""
    json_file: _JsonFile = None
    """write the same to this JSON file"""
    quiet: bool = False
    """no progress on stderr"""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """Options of `report`."""

    output: Path | None = None
    """file of the page; default: the name of the log with .html"""
    model: str | Path | None = None
    """another model; default: the recorded one"""
    overwrite: bool = False
    """replace an existing page"""
    json_file: _JsonFile = None
    """write the figures to this JSON file"""
    quiet: bool = False
    """no progress on stderr"""


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class CompareOptions:
    """Options of `compare`."""

    scenario: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative="")] = (
        "double_lane_change",
    )
    """one or several, each a shipped one or the path of a .toml or .xodr file"""
    seeds: Annotated[int, Field(ge=0, le=1000)] = 0
    """number of drives of each scenario, each with other noise of the sensors; 0: one without"""
    plant: str = "own"
    """own, fmu:FILE.fmu, commonroad:NUMBER or model:BUNDLE"""
    car: str | None = None
    """parameters of the own car: a shipped name, or the path of a .toml file"""
    friction: float | None = None
    """of the road; default: the scenario's"""
    faults: Path | None = None
    """faults of bus and actuators, a .toml file"""
    backend: Literal["loky", "dask", "ray"] = "loky"
    """where the drives run: processes of this machine, a Dask or a Ray cluster"""
    address: str | None = None
    """HOST:PORT of the cluster; default: a new one on this machine"""
    jobs: int = -1
    """processes; -1 is one per core"""
    html: Path | None = None
    """write this page: the table, and an overlay of the drives of each scenario"""
    plot: Path | None = None
    """draw the overlay of the first scenario into this file: .png, .svg or .pdf"""
    results: Path | None = None
    """keep every finished drive in this file; after an interruption the same command goes on"""
    json_file: _JsonFile = None
    """write the figures of all drives to this JSON file"""
    quiet: bool = False
    """no progress on stderr"""


def read_config_file(path: Path) -> Dict:
    """The settings of a TOML file, as a source for cyclopts.

    Raises:
        ConfigError: no such file, no TOML, or settings that are refused: each by its name.
    """
    from rt_controller.contract.files import read_text  # numpy, which --help does without

    try:
        settings = tomllib.loads(read_text(path))
    except OSError as error:
        raise ConfigError(
            f"--config {path}: expected a TOML file, found {error.strerror}. Name another one; a "
            f"pipe cannot be used."
        ) from error
    except (ValueError, RecursionError) as error:  # no UTF-8, no TOML, a number without end
        raise ConfigError(
            f"--config {path}: expected a TOML file in UTF-8, found: {error}. Correct the file."
        ) from error
    try:
        RunOptions.model_validate({"bus": VIRTUAL, **_with_underscores(settings)})
    except ValidationError as error:
        raise ConfigError(f"--config {path}:\n{explain(error, dotted, RunOptions)}") from error
    source = Dict(settings)
    source.source = str(path)
    return source


def read_controller_config(path: Path | None) -> ControllerConfig:
    """The settings of a TOML file; None: the defaults.

    Raises:
        ConfigError: as `read_config_file`.
    """
    if path is None:
        return ControllerConfig()
    settings = _with_underscores(read_config_file(path).config)
    return RunOptions.model_validate({"bus": VIRTUAL, **settings})


def _with_underscores(table: Any) -> Any:
    """The table with its keys as in Python: a file may write ey-m for ey_m, as options do."""
    if not isinstance(table, dict):
        return table
    return {name.replace("-", "_"): _with_underscores(value) for name, value in table.items()}
