"""`car_sources`: the C files of an FMU: generated plant, table of variables, FMI functions."""

import hashlib
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

from sim_bridge.c_code.annotations import table_of
from sim_bridge.c_code.c_types import ArrayType, field_name
from sim_bridge.c_code.program import CProgram
from sim_bridge.c_code.value import number
from sim_bridge.fmu_export import exported_car
from sim_bridge.fmu_export.description import FmiVersion
from sim_bridge.fmu_export.variables import START, FmuVariable
from sim_bridge.plant.consistency import EXPECTED, Contradictions
from sim_bridge.plant.library import STEP_S
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.states import N_STATES

_ARRAYS = dict.fromkeys(("state", "pose", "outputs"), ArrayType.VECTOR)
_COMMON = ("car.h", "car.c", "saved_state.c")
_OF_VERSION = {
    FmiVersion.FMI2: ("fmi2.c",),
    FmiVersion.FMI3: ("fmi3.c", "fmi3_absent.c"),
}


def plant_program(parameters: Parameters) -> CProgram:
    """The plant and the functions around it in C.

    Raises:
        UnsupportedCodeError: a function of the plant has no translation.
    """
    program = CProgram(example=parameters)
    program.add(exported_car.contradiction)
    for kernel in (exported_car.start, exported_car.step, exported_car.write_exported):
        program.add(kernel, _ARRAYS)
    for name, value in (
        ("N_STATES", N_STATES),
        ("N_POSE", exported_car.N_POSE),
        ("N_EXPORTED", exported_car.N_EXPORTED),
    ):
        program.add_constant(name, value)
    return program


def car_sources(
    version: FmiVersion, parameters: Parameters, variables: Sequence[FmuVariable]
) -> tuple[dict[str, str], str]:
    """The files by their names, and the token that identifies them.

    Raises:
        UnsupportedCodeError: a function of the plant has no translation.
    """
    program = plant_program(parameters)
    files = {
        "python_math.h": _text("c_code", "python_math.h"),
        "plant.h": program.header("plant"),
        "plant.c": program.source("plant"),
    }
    for name in (*_COMMON, *_OF_VERSION[version]):
        files[name] = _text("fmu_export", f"sources/{name}")
    table = _variables_c(parameters, variables)
    token = _token({**files, "variables.c": table})
    files["variables.c"] = f'{table}\nconst char CAR_TOKEN[] = "{token}";\n'
    return files, token


def _text(package: str, name: str) -> str:
    return (resources.files("sim_bridge") / package / name).read_text("utf-8")


def _token(files: Mapping[str, str]) -> str:
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(f"{name}\0{files[name]}\0".encode())
    number = digest.hexdigest()
    return f"{{{number[:8]}-{number[8:12]}-{number[12:16]}-{number[16:20]}-{number[20:32]}}}"


def _variables_c(parameters: Parameters, variables: Sequence[FmuVariable]) -> str:
    rows = "".join(
        f'    {{"{variable.name}", offsetof(Car, {variable.place}), {variable.role.value}, '
        f"{variable.limits.lower!r}, {variable.limits.upper!r}, "
        f"{'true' if variable.limits.excludes_lower else 'false'}}},\n"
        for variable in variables
    )
    contradictions = "".join(
        f'    {{"{_variable_of(name)}", "{expected}"}},\n'
        for name, expected in zip(Contradictions._fields, EXPECTED, strict=True)
    )
    return (
        "/* The variables of this car and their start values; generated from its car file. */\n\n"
        f'#include "car.h"\n\nconst double CAR_STEP_S = {STEP_S!r};\n\n'
        f"const Parameters CAR_PARAMETERS = {_braces(parameters)};\n\n"
        f"const ExportedStart CAR_START = {_braces(START)};\n\n"
        f"const CarContradiction CAR_CONTRADICTIONS[] = {{\n{contradictions}}};\n\n"
        f"const uint32_t CAR_N_VARIABLES = {len(variables)};\n\n"
        f"const CarVariable CAR_VARIABLES[] = {{\n{rows}}};\n"
    )


def _variable_of(contradiction: str) -> str:
    """Name in the FMU of a field of `Contradictions`: "tyre_file_pdx1" is tyre_file.pdx1."""
    parts = (part for part in Parameters._fields if contradiction.startswith(f"{part}_"))
    part = max(parts, key=len)
    return f"{part}.{contradiction.removeprefix(f'{part}_')}"


def _braces(value: Any, indent: str = "") -> str:
    """A named tuple or table as a C initialiser, one line for each field."""
    value = table_of(value)
    if not isinstance(value, tuple):
        return number(value).code
    inner = f"{indent}    "
    fields: tuple[str, ...] | None = getattr(value, "_fields", None)
    if fields is None:
        return f"{{{{{', '.join(_braces(item, inner) for item in value)}}}}}"
    lines = "".join(
        f"{inner}.{field_name(name)} = {_braces(item, inner)},\n"
        for name, item in zip(fields, value, strict=True)
    )
    return f"{{\n{lines}{indent}}}"
