"""`model_description`: the modelDescription.xml of the exported FMU, for FMI 2 and FMI 3."""

from collections.abc import Sequence
from enum import IntEnum
from math import inf, nextafter
from xml.etree import ElementTree as Xml

from sim_bridge.fmu_export.exported_car import STATE_FIELDS
from sim_bridge.fmu_export.fmu_units import FmuUnit, display_unit_of
from sim_bridge.fmu_export.variables import FmuVariable, Role
from sim_bridge.plant.library import STEP_S

MODEL_IDENTIFIER = "rt_controller_car"
_STOP_S = 10.0
_LARGEST = 1e300
"""limits of this size are none"""
_CAUSALITY = {
    Role.TIME: "independent",
    Role.INPUT: "input",
    Role.FIXED: "parameter",
    Role.TUNABLE: "parameter",
    Role.OUTPUT: "output",
}
_VARIABILITY = {Role.FIXED: "fixed", Role.TUNABLE: "tunable"}


class FmiVersion(IntEnum):
    """A supported version of FMI."""

    FMI2 = 2
    FMI3 = 3


def model_description(
    version: FmiVersion,
    name: str,
    token: str,
    variables: Sequence[FmuVariable],
    source_files: Sequence[str],
) -> bytes:
    """The file as XML.

    Args:
        name: of the car.
        token: that the library compares at instantiation.
        source_files: C files in `sources/`.
    """
    is_fmi2 = version is FmiVersion.FMI2
    root = Xml.Element(
        "fmiModelDescription",
        {
            "fmiVersion": "2.0" if is_fmi2 else "3.0",
            "modelName": name,
            "guid" if is_fmi2 else "instantiationToken": token,
            "description": f"Nonlinear car {name}, integrated with steps of at most {STEP_S} s",
            "author": "rt-controller",
            "license": "Apache-2.0",
            "generationTool": "rt-controller, sim-bridge export-fmu",
            "variableNamingConvention": "structured",
        },
    )
    simulation = Xml.SubElement(root, "CoSimulation", _capabilities(is_fmi2))
    if is_fmi2:
        files = Xml.SubElement(simulation, "SourceFiles")
        for file in source_files:
            Xml.SubElement(files, "File", {"name": file})
    _write_units(root, variables)
    categories = Xml.SubElement(root, "LogCategories")
    Xml.SubElement(categories, "Category", {"name": "logStatusError"})
    Xml.SubElement(
        root,
        "DefaultExperiment",
        {"startTime": "0", "stopTime": repr(_STOP_S), "stepSize": repr(STEP_S)},
    )
    listed = Xml.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        (_add_fmi2 if is_fmi2 else _add_fmi3)(listed, variable, reference)
    _write_structure(root, variables, is_fmi2)
    return _text(root)


def build_description(source_files: Sequence[str]) -> bytes:
    """The buildDescription.xml that FMI 3 has beside its sources."""
    root = Xml.Element("fmiBuildDescription", {"fmiVersion": "3.0"})
    configuration = Xml.SubElement(
        root, "BuildConfiguration", {"modelIdentifier": MODEL_IDENTIFIER}
    )
    files = Xml.SubElement(configuration, "SourceFileSet", {"language": "C99"})
    for file in source_files:
        Xml.SubElement(files, "SourceFile", {"name": file})
    Xml.SubElement(configuration, "Library", {"name": "m", "external": "true"})
    return _text(root)


def _text(root: Xml.Element) -> bytes:
    Xml.indent(root)
    return bytes(Xml.tostring(root, encoding="utf-8", xml_declaration=True))


def _capabilities(is_fmi2: bool) -> dict[str, str]:
    state = "FMUstate" if is_fmi2 else "FMUState"
    capabilities = {
        "modelIdentifier": MODEL_IDENTIFIER,
        "needsExecutionTool": "false",
        "canHandleVariableCommunicationStepSize": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        f"canGetAndSet{state}": "true",
        f"canSerialize{state}": "true",
        "maxOutputDerivativeOrder": "0",
    }
    if is_fmi2:
        return capabilities | {
            "canInterpolateInputs": "false",
            "canRunAsynchronuously": "false",
            "canNotUseMemoryManagementFunctions": "true",
            "providesDirectionalDerivative": "false",
        }
    return capabilities | {
        "providesDirectionalDerivatives": "false",
        "providesAdjointDerivatives": "false",
        "providesIntermediateUpdate": "false",
        "mightReturnEarlyFromDoStep": "false",
        "canReturnEarlyAfterIntermediateUpdate": "false",
        "hasEventMode": "false",
    }


def _write_units(root: Xml.Element, variables: Sequence[FmuVariable]) -> None:
    units: dict[str, FmuUnit] = {variable.unit.name: variable.unit for variable in variables}
    definitions = Xml.SubElement(root, "UnitDefinitions")
    for unit in units.values():
        entry = Xml.SubElement(definitions, "Unit", {"name": unit.name})
        exponents = {key: getattr(unit, key) for key in ("kg", "m", "s", "rad")}
        base = {key: str(value) for key, value in exponents.items() if value}
        if unit.factor != 1.0:
            base["factor"] = repr(unit.factor)
        Xml.SubElement(entry, "BaseUnit", base)
        display = display_unit_of(unit)
        if display is not None:
            Xml.SubElement(
                entry, "DisplayUnit", {"name": display.name, "factor": repr(display.factor)}
            )


def _attributes(variable: FmuVariable, reference: int) -> dict[str, str]:
    attributes = {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.description,
        "causality": _CAUSALITY[variable.role],
        "variability": _VARIABILITY.get(
            variable.role, "discrete" if variable.is_discrete else "continuous"
        ),
    }
    if variable.role in (Role.FIXED, Role.TUNABLE):
        attributes["initial"] = "exact"
    if variable.role is Role.OUTPUT:
        attributes["initial"] = "calculated"
    return attributes


def _real(variable: FmuVariable) -> dict[str, str]:
    real = {"unit": variable.unit.name}
    display = display_unit_of(variable.unit)
    if display is not None:
        real["displayUnit"] = display.name
    if variable.limits.lower > -_LARGEST:
        # FMI knows no limit that is excluded itself.
        least = nextafter(variable.limits.lower, inf)
        real["min"] = repr(least if variable.limits.excludes_lower else variable.limits.lower)
    if variable.limits.upper < _LARGEST:
        real["max"] = repr(variable.limits.upper)
    if variable.start is not None:
        real["start"] = repr(float(variable.start))
    return real


def _add_fmi2(listed: Xml.Element, variable: FmuVariable, reference: int) -> None:
    entry = Xml.SubElement(listed, "ScalarVariable", _attributes(variable, reference))
    Xml.SubElement(entry, "Real", _real(variable))


def _add_fmi3(listed: Xml.Element, variable: FmuVariable, reference: int) -> None:
    Xml.SubElement(listed, "Float64", _attributes(variable, reference) | _real(variable))


def _write_structure(root: Xml.Element, variables: Sequence[FmuVariable], is_fmi2: bool) -> None:
    """All outputs are unknown at the start: they follow from the settled car.

    Motion and place are states, on which no input acts within a communication point. For further
    outputs this is left open, which means that they may depend on all inputs.
    """
    structure = Xml.SubElement(root, "ModelStructure")
    outputs = [i for i, variable in enumerate(variables) if variable.role is Role.OUTPUT]
    known = [{"dependencies": ""} if variables[i].name in STATE_FIELDS else {} for i in outputs]
    if not is_fmi2:
        for reference, dependencies in zip(outputs, known, strict=True):
            attributes = {"valueReference": str(reference), **dependencies}
            Xml.SubElement(structure, "Output", attributes)
        for reference in outputs:
            Xml.SubElement(structure, "InitialUnknown", {"valueReference": str(reference)})
        return
    group = Xml.SubElement(structure, "Outputs")
    for reference, dependencies in zip(outputs, known, strict=True):
        Xml.SubElement(group, "Unknown", {"index": str(reference + 1), **dependencies})
    group = Xml.SubElement(structure, "InitialUnknowns")
    for reference in outputs:
        Xml.SubElement(group, "Unknown", {"index": str(reference + 1)})
