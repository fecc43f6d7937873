"""`write_fmu`: the controller in C as an FMU for co-simulation, FMI 2.0."""

import hashlib
import platform
import tempfile
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as Xml

from rt_controller.config import MpcSettings
from rt_controller.contract.compiler import CompileError, compile_library
from rt_controller.contract.errors import ConfigError, MissingExtraError
from rt_controller.contract.files import atomic_write
from rt_controller.contract.signals import VEHICLE, CurvaturePreview, PathReference
from rt_controller.contract.timing import PERIOD_S
from rt_controller.model.bundle import Bundle
from rt_controller.native.compiler import SOURCES
from rt_controller.native.constants import constants_of
from rt_controller.native.library import MOST_UNDER_WAY
from rt_controller.native.source import model_source

MODEL_IDENTIFIER = "mdk_controller"
_GLUE = Path(__file__).with_name("fmi2.c")
_OPTIONS = ("-fvisibility=hidden",)
"""several FMUs in one process do not see each other's functions"""
_TIME_STAMP = (2020, 1, 1, 0, 0, 0)
"""of all files inside: the same model and compiler give the same bytes"""


class Variable(NamedTuple):
    """A variable; its value reference is its place in `VARIABLES`, as in fmi2.c."""

    name: str
    unit: str | None
    """None: an integer"""
    causality: str
    description: str


_UNITS: dict[str, dict[str, int]] = {
    "1": {},
    "m": {"m": 1},
    "1/m": {"m": -1},
    "1/m2": {"m": -2},
    "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
}
"""exponents of the base units"""
_STATES = (
    "velocity of the centre of gravity, forward",
    "velocity of the centre of gravity, to the left",
    "yaw rate, positive to the left",
    "progress along the reference line in the last 0.025 s",
    "distance to the left of the reference line",
    "heading relative to the reference line, positive to the left",
)
_INPUTS = ("accelerator pedal", "force on the brake pedal", "steering wheel, positive to the left")
_PATH_UNITS = ("m", "1", "1/m", "1/m2", "m/s", "m/s2")
_PATH = "wanted: e_y(s) = c0 + c1 s + c2 s^2 + c3 s^3, s metres ahead; speed v + a t"
_SPACING = "distance between the five curvatures; 0: the curvature is constant"
_DELAY = (
    "periods of 0.025 s from the sample of the state until the command that answers it acts: 0 if "
    "the vehicle gets it for the same communication step, 1 if for the next one, and those of its "
    "actuators"
)
VARIABLES = (
    *(
        Variable(signal.name, signal.unit, "input", text)
        for signal, text in zip(VEHICLE.states, _STATES, strict=True)
    ),
    Variable("curvature_per_m", "1/m", "input", "of the road at the car, positive to the left"),
    *(
        Variable(f"path.{name}", unit, "input", _PATH)
        for name, unit in zip(PathReference._fields, _PATH_UNITS, strict=True)
    ),
    *(
        Variable(f"preview.{name}", "1/m" if i else "m", "input", text)
        for i, name in enumerate(CurvaturePreview._fields)
        for text in [f"of the road {i - 1} spacings ahead" if i else _SPACING]
    ),
    *(
        Variable(f"start.{signal.name}", signal.unit, "parameter", f"{text}, before the first step")
        for signal, text in zip(VEHICLE.inputs, _INPUTS, strict=True)
    ),
    *(
        Variable(signal.name, signal.unit, "output", text)
        for signal, text in zip(VEHICLE.inputs, _INPUTS, strict=True)
    ),
    Variable("delay_periods", None, "parameter", _DELAY),
    Variable("status", None, "output", "0: planned; otherwise the last plan or input is held"),
    Variable("iterations", None, "output", "of the QP in the last period"),
)


def write_fmu(file: Path, bundle: Bundle, settings: MpcSettings) -> None:
    """Write the FMU of a model and the settings of its control law.

    Raises:
        MissingExtraError: this machine cannot compile it.
        ArtifactError, ConfigError: as `constants_of`.
        ConfigError: the name does not end in .fmu, or the file cannot be written.
    """
    if file.suffix != ".fmu":
        raise ConfigError(
            f"--output: expected a name that ends in .fmu, found {file}. Choose one, as in "
            f"controller.fmu."
        )
    sources = {path.name: path.read_text("utf-8") for path in [*SOURCES.glob("*.[ch]"), _GLUE]}
    sources["mdk_model.c"] = model_source(constants_of(bundle, settings), "MDK_MODEL")
    digest = hashlib.sha256(repr(sorted(sources.items())).encode()).hexdigest()
    guid = f"{{{digest[:8]}-{digest[8:12]}-{digest[12:16]}-{digest[16:20]}-{digest[20:32]}}}"
    sources["mdk_model.c"] += f'\nconst char FMU_GUID[] = "{guid}";\n'
    machine = platform.machine()
    folder = "linux64" if machine == "x86_64" else f"{machine}-linux"
    content = {
        "modelDescription.xml": _model_description(bundle, guid, sources),
        f"binaries/{folder}/{MODEL_IDENTIFIER}.so": _compiled(sources),
        **{f"sources/{name}": text.encode() for name, text in sources.items()},
    }
    try:
        with atomic_write(file) as out, zipfile.ZipFile(out, "w") as archive:
            for name in sorted(content):
                entry = zipfile.ZipInfo(name, _TIME_STAMP)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.external_attr = 0o644 << 16
                archive.writestr(entry, content[name])
    except OSError as error:
        raise ConfigError(
            f"--output: expected a file that can be written, found {file}: {error.strerror}. "
            f"Choose another one."
        ) from error


def _compiled(sources: Mapping[str, str]) -> bytes:
    with tempfile.TemporaryDirectory(prefix="fmu-") as place:
        folder, library = Path(place), Path(place) / "library.so"
        for name, text in sources.items():
            (folder / name).write_text(text, encoding="utf-8")
        try:
            compile_library(sorted(folder.glob("*.c")), library, folder, _OPTIONS)
        except CompileError as error:
            raise MissingExtraError(f"The FMU is not compiled: {error}.") from error
        return library.read_bytes()


def _model_description(bundle: Bundle, guid: str, sources: Iterable[str]) -> bytes:
    """modelDescription.xml; `guid` is what the library compares at instantiation."""
    head = {
        "fmiVersion": "2.0",
        "modelName": f"{bundle.name} controller",
        "guid": guid,
        "description": f"Koopman MPC of a car, model {bundle.name}, SHA-256 {bundle.sha256}",
        "license": "Apache-2.0",
        "generationTool": "rt-controller, offline-export --target fmu",
        "variableNamingConvention": "structured",
    }
    root = Xml.Element("fmiModelDescription", head)
    capabilities = {
        "modelIdentifier": MODEL_IDENTIFIER,
        "canHandleVariableCommunicationStepSize": "false",
        "canNotUseMemoryManagementFunctions": "true",
    }
    files = Xml.SubElement(Xml.SubElement(root, "CoSimulation", capabilities), "SourceFiles")
    for name in sorted(name for name in sources if name.endswith(".c")):
        Xml.SubElement(files, "File", name=name)
    units = Xml.SubElement(root, "UnitDefinitions")
    for unit, exponents in _UNITS.items():
        powers = {base: str(power) for base, power in exponents.items()}
        Xml.SubElement(Xml.SubElement(units, "Unit", name=unit), "BaseUnit", powers)
    Xml.SubElement(Xml.SubElement(root, "LogCategories"), "Category", name="logStatusError")
    Xml.SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(PERIOD_S))
    entries = Xml.SubElement(root, "ModelVariables")
    structure = Xml.SubElement(root, "ModelStructure")
    unknowns = [Xml.SubElement(structure, group) for group in ("Outputs", "InitialUnknowns")]
    for reference, variable in enumerate(VARIABLES):
        _add_variable(entries, variable, reference)
        if variable.causality == "output":
            for group in unknowns:
                Xml.SubElement(group, "Unknown", index=str(reference + 1))
    Xml.indent(root)
    return bytes(Xml.tostring(root, encoding="utf-8", xml_declaration=True))


def _add_variable(entries: Xml.Element, variable: Variable, reference: int) -> None:
    kinds = {
        "input": {"variability": "continuous"},
        "parameter": {"variability": "fixed", "initial": "exact"},
        "output": {"variability": "discrete", "initial": "calculated"},
    }
    attributes = {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.description,
        "causality": variable.causality,
        **kinds[variable.causality],
    }
    entry = Xml.SubElement(entries, "ScalarVariable", attributes)
    start = {} if variable.causality == "output" else {"start": "0"}
    if variable.unit is not None:
        Xml.SubElement(entry, "Real", start, unit=variable.unit)
    elif start:
        Xml.SubElement(entry, "Integer", start, min="0", max=str(MOST_UNDER_WAY))
    else:
        Xml.SubElement(entry, "Integer")
