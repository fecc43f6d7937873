"""`build_fmu`: the own car as an FMU in C for other tools, with its mapping file beside it."""

import hashlib
import platform
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path

from rt_controller.contract.errors import ConfigError, MissingExtraError
from rt_controller.contract.files import atomic_write, write_text
from rt_controller.contract.signals import ControlInput
from sim_bridge.fmu_export.description import MODEL_IDENTIFIER, model_description, variables
from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.compiler import SOURCES, CompileError, compile_library, find_compiler
from sim_bridge.plant.library import STEP_S
from sim_bridge.plant.parameters import Parameters, load_parameters
from sim_bridge.plant.parts import RoadParameters
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs
from sim_bridge.plant.shipped_cars import CARS_FOLDER, DEFAULT_CAR, shipped_cars
from sim_bridge.toml_file import read_shipped_or_own

_TIME_STAMP = (2020, 1, 1, 0, 0, 0)
"""of all files inside: the same car and compiler give the same bytes"""


def build_fmu(file: Path, car: str = DEFAULT_CAR) -> Path:
    """Write the FMU of a car, a shipped one or a file; returns the path of its mapping file.

    Raises:
        MissingExtraError: there is no C compiler.
        ConfigError: there is no such car, it cannot be compiled, or the file cannot be written.
    """
    if file.suffix != ".fmu":
        raise ConfigError(f"{file}: expected a name that ends in .fmu. Choose one, as in car.fmu.")
    mapping = file.with_suffix(".toml")
    if car not in shipped_cars() and mapping.resolve() == Path(car).resolve():
        raise ConfigError(
            f"{file}: expected that its mapping can be written to {mapping}, found the car file "
            f"there. Choose another name for the FMU."
        )
    parameters = load_parameters(car)
    sources = _sources(parameters)
    digest = hashlib.sha256(repr(sorted(sources.items())).encode()).hexdigest()
    token = f"{{{digest[:8]}-{digest[8:12]}-{digest[12:16]}-{digest[16:20]}-{digest[20:32]}}}"
    sources["car_numbers.h"] += f'#define CAR_TOKEN "{token}"\n'
    name = Path(car).stem if car.endswith(".toml") else car
    c_files = sorted(source for source in sources if source.endswith(".c"))
    machine = platform.machine()
    folder = "linux64" if machine == "x86_64" else f"{machine}-linux"
    content = {
        "modelDescription.xml": model_description(name, token, variables(parameters.road), c_files),
        "resources/car.toml": read_shipped_or_own(car, CARS_FOLDER, "car").encode(),
        f"binaries/{folder}/{MODEL_IDENTIFIER}.so": _compiled(sources),
        **{f"sources/{source}": text.encode() for source, text in sources.items()},
    }
    _write_archive(file, content)
    write_text(mapping, mapping_text())
    return mapping


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


def _sources(parameters: Parameters) -> dict[str, str]:
    """The C files by name: the car, the functions of FMI, and the numbers of this car."""
    files = [*sorted(SOURCES.iterdir()), Path(__file__).with_name("fmi2.c")]
    numbers = ", ".join(map(repr, car_record(parameters).tolist()))
    names = ", ".join(f'"{variable.name}"' for variable in variables(parameters.road))
    table = (
        "/* Generated from the car file: its numbers as in Parameters, variable names. */\n\n"
        f"#define CAR_NUMBER_LIST {numbers}\n\n"
        f"static const char *const VARIABLE_NAMES[] = {{{names}}};\n\n"
    )
    return {file.name: file.read_text("utf-8") for file in files} | {"car_numbers.h": table}


def _compiled(sources: Mapping[str, str]) -> bytes:
    try:
        find_compiler()
    except CompileError as error:
        raise MissingExtraError(f"export-fmu: {error}.") from error
    with tempfile.TemporaryDirectory(prefix="export-fmu-") as place:
        folder, library = Path(place), Path(place) / f"{MODEL_IDENTIFIER}.so"
        for name, text in sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        try:
            compile_library(sorted(folder.glob("*.c")), library)
        except CompileError as error:
            raise ConfigError(str(error)) from error
        return library.read_bytes()


def _write_archive(file: Path, content: Mapping[str, bytes]) -> None:
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
