"""The journal beside a log of frames: what the loop did between them, one line of JSON per tick.

With it a drive can be replayed: a candump line has neither the instant at which a tick read the
frame, nor the order of reading, preparing and sending. The journal names frames by their order in
the log, so the log stays one that every reader of its format opens. The first line is the header.
"""

import json
import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import Enum
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, BeforeValidator, NonNegativeInt, PositiveInt, TypeAdapter
from pydantic import ValidationError as Refused

from rt_controller.bus.identity import dbc_hash
from rt_controller.bus.log.recorder import journal_path
from rt_controller.config import ControllerConfig
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.faults import StopCause
from rt_controller.contract.files import open_regular
from rt_controller.contract.settings_errors import dotted, explain
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.controllers import absolute_name, law_digest
from rt_controller.model.artifact import find_model, load_bundle
from rt_controller.model.bundle import Bundle

FORMAT: Literal[1] = 1
BUS_FAILURE = "bus_failure"
_CallName = Literal[
    "received",
    "sent",
    "bus_failure",
    "update_matrices",
    "warm_up",
    "request_stop",
    "send_safe_command",
]
"""the last four are methods of `ControlStep`, and the names with which it notes their calls"""
_PACKAGES = ("rt-controller", "numpy", "scipy", "onnxruntime", "piqp")
"""those on which the bits of a command depend"""


class Call(NamedTuple):
    """Something that happened before the end of a tick."""

    name: _CallName
    stamp_ns: NonNegativeInt = 0
    """of frames"""
    n_frames: NonNegativeInt = 0
    """that the log has, one after the other"""
    frames: tuple[Any, ...] = ()
    """these frames, as `can.Message`, of a drive that was read"""


def _member(kind: type[Enum], name: object) -> Enum:
    """The member of this name; other names are refused by pydantic, with the field."""
    if name not in kind.__members__:
        raise ValueError(f"expected one of {', '.join(kind.__members__)}")
    return kind[str(name)]


@dataclass(frozen=True, slots=True)
class TickRecord:
    """One tick; with its calls all that its result depends on. The fields of a line."""

    tick: int
    """its number, counted from zero; -1: calls after the last tick"""
    began_ns: NonNegativeInt = 0
    scheduled_ns: NonNegativeInt = 0
    skipped: NonNegativeInt = 0
    missed_last: bool = False
    mode: Annotated[Mode, BeforeValidator(partial(_member, Mode))] = Mode.STANDBY
    cause: Annotated[StopCause, BeforeValidator(partial(_member, StopCause))] = StopCause.NONE
    control: ControlInput | None = None
    faults: int = 0
    dropped: NonNegativeInt = 0
    """frames that were missing in the log by then"""
    sent_after_us: float = 0.0
    late_cause: str | None = None
    times: Mapping[str, float] = field(default_factory=dict)
    """by field of `TickTimes`"""
    calls: tuple[Call, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """The line without the calls, which the recorder adds."""
        line = {each.name: getattr(self, each.name) for each in fields(self)}
        return {**line, "mode": self.mode.name, "cause": self.cause.name}

    def frames(self, name: str) -> list[Any]:
        """All frames that were received, or sent, before the end of the tick."""
        return [frame for call in self.calls if call.name == name for frame in call.frames]


class Header(BaseModel):
    """The first line: settings, model and versions that a replay needs."""

    journal_format: Literal[1]
    version: str
    model: dict[str, str]
    """name, sha256"""
    controller_sha256: str = ""
    """of the file of a control law"""
    config: dict[str, Any]
    max_iterations: PositiveInt | None
    """of a solve, where its time is limited"""
    catalogue: str
    """hash of the messages"""
    packages: dict[str, str | None]
    machine: str

    def controller_config(self) -> ControllerConfig:
        """The settings of the run; without its core, which this machine may not have.

        Raises:
            ConfigError: this version has other settings, or the file of the law has changed.
        """
        try:
            realtime = {**self.config.get("realtime", {}), "cpu": None}
            config = ControllerConfig(**{**self.config, "realtime": realtime})
        except ConfigError as error:
            raise ConfigError(
                f"Settings in the journal: {error} Replay the drive with the version that recorded "
                f"it ({self.version})."
            ) from None
        if law_digest(config.controller) != self.controller_sha256:
            raise ConfigError(
                f"the controller {config.controller}: expected the recorded one, found that its "
                f"file has changed since. Replay with the file that drove."
            )
        return config

    def load_model(self, model: str | Path | None = None) -> Bundle:
        """The model of the run, or another one if `model` names it.

        Raises:
            ArtifactError: it cannot be loaded.
            ConfigError: none is named, and that of the run has changed since.
        """
        source = self.config.get("model") if model is None else model
        bundle = load_bundle(find_model(source))
        recorded = self.model.get("sha256", "")
        if model is None and bundle.sha256 != recorded:
            raise ConfigError(
                f"the model {source or bundle.name}: expected the recorded one, {recorded[:8]}, "
                f"found {bundle.sha256[:8]}. Name its folder with --model, or another model to see "
                f"what it would have commanded."
            )
        return bundle

    def changed_versions(self) -> list[str]:
        """Packages, messages and the type of machine that are others now, for people."""
        recorded = {**self.packages, "messages": self.catalogue, "machine": self.machine}
        now = {name: _version(name) for name in self.packages}
        now |= {"messages": f"{dbc_hash():08x}", "machine": _machine()}
        return [
            f"{name} {then} then, {now[name]} now"
            for name, then in recorded.items()
            if then != now[name]
        ]


def describe_run(config: ControllerConfig, bundle: Bundle, max_iterations: int | None) -> Header:
    """Settings, model, limits found at the start, and versions."""
    settings = {name: getattr(config, name) for name in ControllerConfig.model_fields}
    settings["mpc"] = config.mpc.for_model(bundle)
    if config.model is not None and os.path.exists(str(config.model)):
        settings["model"] = str(Path(config.model).resolve())
    if config.controller is not None:
        settings["controller"] = absolute_name(config.controller)
    return Header(
        journal_format=FORMAT,
        version=version("rt-controller"),
        model={"name": bundle.name, "sha256": bundle.sha256},
        controller_sha256=law_digest(config.controller),
        config=ControllerConfig(**settings).model_dump(),
        max_iterations=max_iterations,
        catalogue=f"{dbc_hash():08x}",
        packages={name: _version(name) for name in _PACKAGES},
        machine=_machine(),
    )


def _machine() -> str:
    return f"{platform.system()} {platform.machine()}"


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def read_journal(log: Path) -> tuple[Header, list[TickRecord]]:
    """Header and ticks of the journal beside `log`.

    Raises:
        ConfigError: there is none, or it is not one.
    """
    path, number = journal_path(log), 1
    tick = TypeAdapter(TickRecord)
    try:
        with open_regular(path) as file:
            header = Header.model_validate(_object(file.readline()))
            ticks = []
            for line in file:
                number += 1
                ticks.append(tick.validate_python(_object(line)))
        return header, ticks
    except (Refused, _NoObjectError) as error:
        found = explain(error, dotted) if isinstance(error, Refused) else f"{error}."
        raise ConfigError(
            f"{path}, line {number}: expected a JSON object, one a tick, as this version writes "
            f"them:\n{found}\nCopy it again, or use the version that recorded it; a journal that "
            f"was cut off may end after any whole line."
        ) from error
    except FileNotFoundError:
        if not log.exists():
            raise ConfigError(
                f"{log}: expected a log that --record wrote, found no such file. Correct the path."
            ) from None
        raise ConfigError(
            f"{log}: expected its journal {path.name} in the same folder, found none. It says what "
            f"each tick had read: rt-controller --record writes both; keep them together. A log "
            f"of another program, or an MCAP file, has none, and cannot be replayed."
        ) from None
    except OSError as error:
        raise ConfigError(
            f"{path}: expected a journal that can be read, found {error.strerror}. Correct its "
            f"permissions."
        ) from error


class _NoObjectError(Exception):
    """A line is no JSON object."""


def _object(line: str | bytes) -> dict[str, Any]:
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise _NoObjectError("found another text, or a part of one")
    return content
