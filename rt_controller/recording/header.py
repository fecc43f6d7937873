"""Header of a journal: settings, model and versions that a replay needs."""

import os
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from rt_controller.bus.identity import dbc_hash
from rt_controller.config import ControllerConfig
from rt_controller.contract.errors import ConfigError
from rt_controller.model.artifact import find_model, load_bundle
from rt_controller.model.bundle import Bundle

_PACKAGES = ("rt-controller", "numpy", "scipy", "onnxruntime", "piqp")
"""those on which the bits of a command depend"""


def describe_run(
    config: ControllerConfig, bundle: Bundle, max_iterations: int | None, is_fd: bool = False
) -> dict[str, Any]:
    """Settings, model, limits found at the start, and versions."""
    settings = {name: getattr(config, name) for name in ControllerConfig.model_fields}
    settings["mpc"] = config.mpc.for_model(bundle)
    model = config.model
    if model is not None and os.path.exists(str(model)):
        model = str(Path(model).resolve())
    return {
        "version": version("rt-controller"),
        "model": {"name": bundle.name, "sha256": bundle.sha256},
        "config": ControllerConfig(**{**settings, "model": model}).model_dump(),
        "max_iterations": max_iterations,
        "catalogue": _messages(is_fd),
        "is_fd": is_fd,
        "packages": {name: _version(name) for name in _PACKAGES},
        "machine": _machine(),
    }


def recorded_config(header: Mapping[str, Any]) -> ControllerConfig:
    """The settings of the recorded run; its core is left out, which this machine may not have.

    Raises:
        ConfigError: this version has other settings.
    """
    try:
        settings = dict(header["config"])
        if isinstance(settings.get("realtime"), Mapping):
            settings["realtime"] = {**settings["realtime"], "cpu": None}
        return ControllerConfig(**settings)
    except ConfigError as error:
        raise ConfigError(
            f"Settings in the journal: {error} Replay the drive with the version that recorded it "
            f"({header['version']})."
        ) from None


def load_recorded_model(header: Mapping[str, Any], model: str | Path | None = None) -> Bundle:
    """The model of the recorded run, or another one if `model` names it.

    Raises:
        ArtifactError: it cannot be loaded.
        ConfigError: none is named, and that of the run has changed since.
    """
    source = header["config"].get("model") if model is None else model
    bundle = load_bundle(find_model(source))
    recorded = header["model"]["sha256"]
    if model is None and bundle.sha256 != recorded:
        raise ConfigError(
            f"the model {source or bundle.name}: expected the recorded one, {recorded[:8]}, found "
            f"{bundle.sha256[:8]}. Name its folder with --model, or another model to see what it "
            f"would have commanded."
        )
    return bundle


def changed_versions(header: Mapping[str, Any]) -> list[str]:
    """Packages, messages and the type of machine that are others now, for people."""
    recorded = {**header["packages"], "messages": header["catalogue"], "machine": header["machine"]}
    now = {name: _version(name) for name in header["packages"]}
    now |= {"messages": _messages(bool(header.get("is_fd"))), "machine": _machine()}
    return [
        f"{name} {then} then, {now[name]} now"
        for name, then in recorded.items()
        if then != now[name]
    ]


def _messages(is_fd: bool) -> str:
    """Hash of the message catalogue."""
    return f"{dbc_hash(is_fd):08x}"


def _machine() -> str:
    return f"{platform.system()} {platform.machine()}"


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
