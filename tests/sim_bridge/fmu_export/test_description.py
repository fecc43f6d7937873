"""What the exported FMU declares: units, descriptions, start values, unknowns, capabilities."""

import tomllib
import zipfile
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")

from c_compiler import needs_c_compiler
from exported_fmu import CAR, ExportedFmu, exported
from fmpy.validation import validate_fmu

from sim_bridge.fmu_export.description import FmiVersion
from sim_bridge.fmu_export.exported_car import OUTPUT_FIELDS
from sim_bridge.plant.library import STEP_S

pytestmark = needs_c_compiler


@pytest.fixture(params=list(FmiVersion), ids=["fmi2", "fmi3"])
def file(request: pytest.FixtureRequest) -> Path:
    return exported(request.param)


def description_of(file: Path) -> Xml.Element:
    with zipfile.ZipFile(file) as archive:
        return Xml.fromstring(archive.read("modelDescription.xml"))


def test_fmpy_finds_no_problem(file: Path) -> None:
    assert validate_fmu(str(file)) == []


def test_every_variable_has_a_unit_and_a_description(file: Path) -> None:
    description = ExportedFmu(file).description
    units = {unit.name: unit for unit in description.unitDefinitions}
    variables = {variable.name: variable for variable in description.modelVariables}
    for variable in variables.values():
        assert variable.description, variable.name
        assert variable.unit in units, variable.name
    for name, unit in (
        ("steer_rad", "rad"),
        ("brake_n", "N"),
        ("v0_mps", "m/s"),
        ("curvature_per_m", "1/m"),
        ("throttle", "1"),
        ("out_engine_rpm", "rpm"),
        ("out_brake_mpa", "MPa"),
        ("body.yaw_inertia_kgm2", "kg.m2"),
        ("converter.capacity_nm_per_rpm2", "N.m/rpm2"),
        ("brakes.pedal_mpa_per_n", "MPa/N"),
        ("tyre.lateral_friction_per_load", "1"),
        ("tyre.rolling_resistance_spm", "s/m"),
        ("steering.stiffness_nmprad", "N.m/rad"),
    ):
        assert variables[name].unit == unit, name
    pressure = units["MPa/N"].baseUnit
    assert (pressure.kg, pressure.m, pressure.s) == (0, -2, 0)
    assert pressure.factor == pytest.approx(1e6)
    assert units["rad"].displayUnits[0].name == "deg"


def test_start_values_are_those_of_the_car_file_with_their_sources(file: Path) -> None:
    text = (resources.files("sim_bridge") / "cars" / f"{CAR}.toml").read_text("utf-8")
    variables = {v.name: v for v in ExportedFmu(file).description.modelVariables}
    n_values = 0
    for part, entries in tomllib.loads(text).items():
        for name, entry in entries.items():
            for index, number in numbers_of(entry["value"]):
                variable = variables[f"{part}.{name}{index}"]
                assert float(variable.start) == number
                assert entry["source"] in variable.description
                assert variable.variability == ("tunable" if part == "road" else "fixed")
                n_values += 1
    assert n_values > 100


def numbers_of(value: Any, index: str = "") -> Iterator[tuple[str, float]]:
    """The numbers of an entry with their indices, [2,1] being the first of the second row."""
    if not isinstance(value, list):
        yield (f"[{index}]" if index else ""), value
        return
    for i, item in enumerate(value, 1):
        yield from numbers_of(item, f"{index},{i}" if index else str(i))


def test_initial_unknowns_are_the_outputs() -> None:
    for version in FmiVersion:
        root = description_of(exported(version))
        variables = list(root.find("ModelVariables"))  # type: ignore[arg-type]
        structure = root.find("ModelStructure")
        assert structure is not None
        for group in ("Outputs", "InitialUnknowns"):
            if version is FmiVersion.FMI2:
                found = structure.find(group)
                assert found is not None
                names = [variables[int(u.get("index", 0)) - 1].get("name") for u in found]
            else:
                found_all = structure.findall(group.removesuffix("s"))
                by_reference = {v.get("valueReference"): v.get("name") for v in variables}
                names = [by_reference[u.get("valueReference")] for u in found_all]
            assert names == list(OUTPUT_FIELDS)


def test_the_flags_are_what_the_library_does(file: Path) -> None:
    root = description_of(file)
    flags = dict(root.find("CoSimulation").attrib)  # type: ignore[union-attr]
    assert flags["needsExecutionTool"] == "false"
    assert flags["canHandleVariableCommunicationStepSize"] == "true"
    assert "fixedInternalStepSize" not in flags
    assert flags["canBeInstantiatedOnlyOncePerProcess"] == "false"
    assert {flags.get("canGetAndSetFMUstate"), flags.get("canGetAndSetFMUState")} == {None, "true"}
    experiment = root.find("DefaultExperiment")
    assert experiment is not None
    assert float(experiment.get("stepSize", 0)) == STEP_S
