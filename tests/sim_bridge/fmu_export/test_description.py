"""What the exported FMU declares: units, descriptions, start values, unknowns, capabilities."""

import zipfile
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")

from c_compiler import needs_c_compiler
from exported_fmu import CAR, ExportedFmu, exported
from fmpy.validation import validate_fmu

from sim_bridge.plant.library import STEP_S
from sim_bridge.plant.parameters import load_parameters

pytestmark = needs_c_compiler


@pytest.fixture(scope="module")
def file() -> Path:
    return exported()


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
    ):
        assert variables[name].unit == unit, name
    pressure = units["MPa"].baseUnit
    assert (pressure.kg, pressure.m, pressure.s) == (1, -1, -2)
    assert pressure.factor == pytest.approx(1e6)
    assert units["rad"].displayUnits[0].name == "deg"


def test_the_road_starts_as_in_the_car_file_and_is_tunable(file: Path) -> None:
    variables = {v.name: v for v in ExportedFmu(file).description.modelVariables}
    for name, value in load_parameters(CAR).road._asdict().items():
        assert float(variables[f"road.{name}"].start) == value
        assert variables[f"road.{name}"].variability == "tunable"


def test_the_flags_are_what_the_library_does(file: Path) -> None:
    root = description_of(file)
    flags = dict(root.find("CoSimulation").attrib)  # type: ignore[union-attr]
    assert flags["canHandleVariableCommunicationStepSize"] == "true"
    assert flags["canGetAndSetFMUstate"] == "true"
    assert not {"fixedInternalStepSize", "canSerializeFMUstate"} & set(flags)
    experiment = root.find("DefaultExperiment")
    assert experiment is not None
    assert float(experiment.get("stepSize", 0)) == STEP_S
