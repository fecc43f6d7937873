"""`model_description`: the variables of the exported FMU and its modelDescription.xml, FMI 2.0."""

from collections.abc import Sequence
from math import pi
from typing import NamedTuple
from xml.etree import ElementTree as Xml

from sim_bridge.plant.library import STEP_S
from sim_bridge.plant.parts import STEEPEST_RAD, RoadParameters
from sim_bridge.plant.protocol import FASTEST_START_MPS, MOTION_FIELDS, PlantOutputs

MODEL_IDENTIFIER = "rt_controller_car"
POSE_FIELDS = ("s_m", "ey_m", "epsi_rad")
STATE_FIELDS = (*MOTION_FIELDS, *POSE_FIELDS)
"""outputs that are states, on which no input acts directly"""
OUTPUT_FIELDS = (*STATE_FIELDS, *(f"out_{name}" for name in PlantOutputs._fields))
"""names of the outputs; further ones have a prefix, since `throttle` is an input too"""
_STOP_S = 10.0


class Variable(NamedTuple):
    """A variable; its value reference is its place in the list, as in `Values` in fmi2.c."""

    name: str
    causality: str
    variability: str
    description: str
    start: float | None = None
    least: float | None = None
    most: float | None = None


_DESCRIPTIONS = {
    "vx_mps": "velocity of the centre of gravity, forward",
    "vy_mps": "velocity of the centre of gravity, to the left",
    "yaw_rate_radps": "yaw rate, positive to the left",
    "s_m": "progress along the reference line; on a straight road the position x",
    "ey_m": "distance to the left of the reference line; on a straight road the position y",
    "epsi_rad": "heading relative to the reference line; on a straight road the yaw angle",
    "out_roll_rad": "roll, positive: the right side is lower",
    "out_pitch_rad": "pitch, positive: the nose is lower",
    "out_throttle": "opening of the throttle, after its lag",
    "out_brake_mpa": "brake pressure of the front circuit",
    "out_steering_wheel_nm": "torque at the steering wheel without power assistance",
}


_INPUT = ("input", "continuous")
_FIXED, _TUNABLE = ("parameter", "fixed"), ("parameter", "tunable")


def variables(road: RoadParameters) -> list[Variable]:
    """All variables; `road` is that of the car file."""
    slope: tuple[float, float | None] = (-STEEPEST_RAD, STEEPEST_RAD)
    limits = {"bank_rad": slope, "grade_rad": slope}
    limits |= {"friction_left": (1e-6, None), "friction_right": (1e-6, None)}
    outputs = {n: _DESCRIPTIONS.get(n) or _words(n.removeprefix("out_")) for n in OUTPUT_FIELDS}
    brake = "force on the brake pedal; negative values count as 0"
    curvature = "of the road, positive to the left; for s, e_y, e_psi"
    return [
        Variable("time", "independent", "continuous", "simulated time"),
        Variable("throttle", *_INPUT, "accelerator pedal; limited to 0..1", 0.0, 0.0, 1.0),
        Variable("brake_n", *_INPUT, brake, 0.0, 0.0),
        Variable("steer_rad", *_INPUT, "angle of the steering wheel, positive to the left", 0.0),
        Variable("curvature_per_m", *_INPUT, curvature, 0.0),
        Variable("v0_mps", *_FIXED, "initial speed", 20.0, 0.0, FASTEST_START_MPS),
        Variable("ey0_m", *_FIXED, "initial distance to the left of the reference line", 0.0),
        Variable("epsi0_rad", *_FIXED, "initial heading relative to the reference line", 0.0),
        *(
            Variable(f"road.{n}", *_TUNABLE, _words(f"road_{n}"), value, *limits.get(n, ()))
            for n, value in road._asdict().items()
        ),
        *(
            Variable(name, "output", "discrete" if name == "out_gear" else "continuous", text)
            for name, text in outputs.items()
        ),
    ]


class _Unit(NamedTuple):
    """Value in SI base units = factor * value."""

    name: str
    exponents: dict[str, int]
    factor: float = 1.0
    display: tuple[str, float] | None = None
    """a unit for people: displayed value = factor * value"""


_DEG = ("deg", 180.0 / pi)
_UNITS = {
    "m": _Unit("m", {"m": 1}),
    "s": _Unit("s", {"s": 1}),
    "rad": _Unit("rad", {"rad": 1}, display=_DEG),
    "n": _Unit("N", {"kg": 1, "m": 1, "s": -2}),
    "nm": _Unit("N.m", {"kg": 1, "m": 2, "s": -2}),
    "mpa": _Unit("MPa", {"kg": 1, "m": -1, "s": -2}, 1e6),
    "mps": _Unit("m/s", {"m": 1, "s": -1}, display=("km/h", 3.6)),
    "mps2": _Unit("m/s2", {"m": 1, "s": -2}),
    "radps": _Unit("rad/s", {"rad": 1, "s": -1}, display=("deg/s", 180.0 / pi)),
    "rpm": _Unit("rpm", {"rad": 1, "s": -1}, pi / 30.0),
    "per_m": _Unit("1/m", {"m": -1}),
}
"""by the end of a name; a name that ends otherwise is a number without unit"""


def _unit_of(name: str) -> _Unit:
    if name.endswith("_per_m"):
        return _UNITS["per_m"]
    ending = "s" if name == "time" else name[name.find("_") :].rpartition("_")[2]
    return _UNITS.get(ending, _Unit("1", {}))


def _words(name: str) -> str:
    """The name in words, without its unit."""
    first, *words = name.split("_")
    return " ".join((first, *(words[:-1] if words and words[-1] in _UNITS else words)))


def model_description(
    car: str, token: str, listed: Sequence[Variable], source_files: Sequence[str]
) -> bytes:
    """The file as XML; `token` is what the library compares at instantiation."""
    head = {
        "fmiVersion": "2.0",
        "modelName": car,
        "guid": token,
        "description": f"Nonlinear car {car}, integrated with steps of at most {STEP_S} s",
        "author": "rt-controller",
        "license": "Apache-2.0",
        "generationTool": "rt-controller, sim-bridge export-fmu",
        "variableNamingConvention": "structured",
    }
    root = Xml.Element("fmiModelDescription", head)
    capabilities = {
        "modelIdentifier": MODEL_IDENTIFIER,
        "needsExecutionTool": "false",
        "canHandleVariableCommunicationStepSize": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        "canGetAndSetFMUstate": "true",
        "canNotUseMemoryManagementFunctions": "true",
    }
    files = Xml.SubElement(Xml.SubElement(root, "CoSimulation", capabilities), "SourceFiles")
    for file in source_files:
        Xml.SubElement(files, "File", {"name": file})
    _add_units(root, listed)
    categories = Xml.SubElement(root, "LogCategories")
    Xml.SubElement(categories, "Category", {"name": "logStatusError"})
    times = {"startTime": "0", "stopTime": repr(_STOP_S), "stepSize": repr(STEP_S)}
    Xml.SubElement(root, "DefaultExperiment", times)
    entries = Xml.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(listed):
        _add_variable(entries, variable, reference)
    _add_structure(root, listed)
    Xml.indent(root)
    return bytes(Xml.tostring(root, encoding="utf-8", xml_declaration=True))


def _add_units(root: Xml.Element, listed: Sequence[Variable]) -> None:
    definitions = Xml.SubElement(root, "UnitDefinitions")
    units = {unit.name: unit for unit in (_unit_of(variable.name) for variable in listed)}
    for unit in units.values():
        entry = Xml.SubElement(definitions, "Unit", {"name": unit.name})
        base = {name: str(power) for name, power in unit.exponents.items()}
        factor = {"factor": repr(unit.factor)} if unit.factor != 1.0 else {}
        Xml.SubElement(entry, "BaseUnit", base | factor)
        if unit.display is not None:
            display = {"name": unit.display[0], "factor": repr(unit.display[1])}
            Xml.SubElement(entry, "DisplayUnit", display)


def _add_variable(entries: Xml.Element, variable: Variable, reference: int) -> None:
    attributes = {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.description,
        "causality": variable.causality,
        "variability": variable.variability,
    }
    if initial := {"parameter": "exact", "output": "calculated"}.get(variable.causality):
        attributes["initial"] = initial
    unit = _unit_of(variable.name)
    real = {"unit": unit.name} | ({"displayUnit": unit.display[0]} if unit.display else {})
    numbers = (("min", variable.least), ("max", variable.most), ("start", variable.start))
    real |= {name: repr(float(number)) for name, number in numbers if number is not None}
    Xml.SubElement(Xml.SubElement(entries, "ScalarVariable", attributes), "Real", real)


def _add_structure(root: Xml.Element, listed: Sequence[Variable]) -> None:
    """All outputs are unknown at the start: they follow from the settled car.

    Motion and place are states, on which no input acts within a communication point. For further
    outputs this is left open, which means that they may depend on all inputs.
    """
    structure = Xml.SubElement(root, "ModelStructure")
    for group in ("Outputs", "InitialUnknowns"):
        entries = Xml.SubElement(structure, group)
        for index, variable in enumerate(listed, 1):
            if variable.causality == "output":
                unknown = Xml.SubElement(entries, "Unknown", {"index": str(index)})
                if group == "Outputs" and variable.name in STATE_FIELDS:
                    unknown.set("dependencies", "")
