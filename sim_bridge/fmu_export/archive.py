"""`write_fmu`: the own car as an FMU file; `mapping_text`: the mapping file for it."""

import platform
import tempfile
import tomllib
import zipfile
from pathlib import Path

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import atomic_write
from rt_controller.contract.signals import ControlInput
from sim_bridge.fmu_export.car_sources import car_sources
from sim_bridge.fmu_export.compiler import compile_library
from sim_bridge.fmu_export.description import (
    MODEL_IDENTIFIER,
    FmiVersion,
    build_description,
    model_description,
)
from sim_bridge.fmu_export.variables import fmu_variables
from sim_bridge.plant.library import STEP_S
from sim_bridge.plant.parameters import load_parameters
from sim_bridge.plant.parts import RoadParameters
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs
from sim_bridge.plant.shipped_cars import CARS_FOLDER
from sim_bridge.toml_file import read_shipped_or_own

_TIME_STAMP = (2020, 1, 1, 0, 0, 0)
"""of all files inside: the same car and compiler give the same bytes"""


def write_fmu(file: Path, car: str, version: FmiVersion) -> None:
    """Write the FMU of a car.

    Raises:
        MissingExtraError: there is no C compiler.
        ConfigError: there is no such car, it cannot be compiled, or the file cannot be written.
        UnsupportedCodeError: a function of the plant has no translation to C.
    """
    parameters = load_parameters(car)
    text = read_shipped_or_own(car, CARS_FOLDER, "car")
    variables = fmu_variables(parameters, _sources_of_values(text))
    files, token = car_sources(version, parameters, variables)
    c_files = [name for name in files if name.endswith(".c")]
    name = Path(car).stem if car.endswith(".toml") else car
    content = {
        "modelDescription.xml": model_description(version, name, token, variables, c_files),
        "resources/car.toml": text.encode(),
        **{f"sources/{source}": text_of.encode() for source, text_of in files.items()},
    }
    if version is FmiVersion.FMI3:
        content["sources/buildDescription.xml"] = build_description(c_files)
    with tempfile.TemporaryDirectory(prefix="export-fmu-") as folder:
        for source, text_of in files.items():
            (Path(folder) / source).write_text(text_of, encoding="utf-8")
        library = Path(folder) / f"{MODEL_IDENTIFIER}.so"
        compile_library([Path(folder) / source for source in c_files], library)
        content[f"binaries/{platform_folder(version)}/{library.name}"] = library.read_bytes()
    _write_archive(file, content)


def platform_folder(version: FmiVersion) -> str:
    """Name of the folder for libraries of this machine."""
    machine = platform.machine()
    if version is FmiVersion.FMI2 and machine == "x86_64":
        return "linux64"
    return f"{machine}-linux"


def mapping_text() -> str:
    """The mapping file of an exported FMU."""
    lines = [
        "# Which variable of the FMU is which signal of the contract.",
        f"communication_step_s = {STEP_S}  # time between two exchanges of values",
        "",
        "[inputs]",
        *(f'{name} = "{name}"' for name in ControlInput._fields),
        "",
        "[outputs]",
        *(f'{name} = "{name}"' for name in MOTION_FIELDS),
        *(f'{name} = "out_{name}"' for name in PlantOutputs._fields),
        "",
        "[start]",
        'vx_mps = "v0_mps"',
        'road_friction = "road.friction_left"',
        'road_friction_right = "road.friction_right"',
        "",
        "[road]",
        *(f'{name} = "road.{name}"' for name in RoadParameters._fields),
    ]
    return "\n".join(lines) + "\n"


def _sources_of_values(text: str) -> dict[str, str]:
    """By name of a parameter, or of a part that is one entry: where its value comes from."""
    sources: dict[str, str] = {}
    for part, entries in tomllib.loads(text).items():
        if isinstance(entries.get("source"), str):
            sources[part] = entries["source"]
            continue
        for name, entry in entries.items():
            if isinstance(entry, dict) and "source" in entry:
                sources[f"{part}.{name}"] = entry["source"]
    return sources


def _write_archive(file: Path, content: dict[str, bytes]) -> None:
    try:
        with atomic_write(file) as out, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(content):
                entry = zipfile.ZipInfo(name, _TIME_STAMP)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.external_attr = (0o755 if name.endswith(".so") else 0o644) << 16
                archive.writestr(entry, content[name])
    except OSError as error:
        raise ConfigError(
            f"{file}: expected a place that can be written to, found {error.strerror}. Choose "
            f"another."
        ) from error
