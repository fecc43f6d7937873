"""`compile_car`: the simulated car as a shared library, which is named after its sources.

The build of the package imports this file before the package is installed: it may import the
standard library and the compiler of the contract only.
"""

import ast
import tempfile
from pathlib import Path

from rt_controller.contract.compiler import compile_library, library_name, remove_others

OPTIONS = ("-O2", "-fvisibility=hidden")
SOURCES = Path(__file__).with_name("c")
BUILT = Path(__file__).with_name("built")
"""where the compiled car is, in an installation and in a checkout"""
_RECORDS = ("parts.py", "tyre_file.py", "parameters.py", "states.py", "protocol.py")
"""files whose named tuples `…Parameters` are the numbers of a car"""
_STRUCTS = {"StateIndex": "State", "PlantOutputs": "Outputs"}
"""by the other named tuples that the compiler gets"""
_ARRAYS = {"Ratios": "[N_GEARS]", "Efficiencies": "[N_GEARS]", "MapTorques": "[N_MAP][N_MAP]"}
_OF_FILE = {"_FromTyreFile": "TyreFileParameters"}
_ARRAYS |= {"MapSpeeds": "[N_MAP]", "MapPedals": "[N_MAP]", "PerWheel": "[N_WHEELS]"}


def records_header() -> str:
    """`records.h`: the named tuples of a car as structs of doubles, fields in their order.

    So the record that `car_record` makes is passed to C as it is. Four fields of the wheels in
    their order, such as `load_front_left_n`, are one array, `load_n`.
    """
    texts = (Path(__file__).with_name(name).read_text("utf-8") for name in _RECORDS)
    nodes = (node for text in texts for node in ast.parse(text).body)
    lines = ["/* Made from the named tuples of sim_bridge/plant. */", "#pragma once"]
    for name, fields in map(_record, nodes):
        if isinstance(fields, int):
            lines.append(f"#define {name} {fields}")
            continue
        if not name.endswith("Parameters") and name not in _STRUCTS:
            continue
        lines.append("typedef struct {")
        for field, annotation in fields:
            if "_front_right_" in field or "_rear_left_" in field or "_rear_right_" in field:
                continue
            kind = _OF_FILE.get(annotation, annotation).removeprefix("parts.")
            size = _ARRAYS.get("PerWheel" if "_front_left_" in field else kind, "")
            c_type = kind if kind.endswith("Parameters") else "double"
            lines.append(f"{c_type} {field.replace('_front_left_', '_')}{size};")
        lines.append(f"}} {_STRUCTS.get(name, name)};")
    return "\n".join((*lines, ""))


def _record(node: ast.stmt) -> tuple[str, list[tuple[str, str]] | int]:
    """Name, and fields with their annotations, of a named tuple; a size `N_…`; else no name."""
    if isinstance(node, ast.ClassDef):
        fields = [each for each in node.body if isinstance(each, ast.AnnAssign)]
        found = [(ast.unparse(each.target), ast.unparse(each.annotation)) for each in fields]
        return node.name, found
    name = ast.unparse(node.targets[0]) if isinstance(node, ast.Assign) else ""
    if isinstance(node, ast.Assign) and name.startswith("N_"):
        is_number = isinstance(node.value, ast.Constant)
        return (name, int(ast.literal_eval(node.value))) if is_number else ("", [])
    if isinstance(node, ast.Assign) and ast.unparse(node.value).startswith("namedtuple("):
        name, names = (ast.literal_eval(each) for each in node.value.args)  # type: ignore[attr-defined]
        return name, [(each, "Number") for each in names.split()]
    return "", []


def car_library_name() -> str:
    """File name of the car that is compiled from the present sources for this kind of processor."""
    return library_name("car", [*SOURCES.iterdir()], f"{OPTIONS} {records_header()}")


def compile_car(folder: Path) -> Path:
    """Compile the car into a folder, unless it is there; cars of other sources are removed.

    Raises:
        CompileError: there is no C compiler, or it does not compile them.
        OSError: the folder cannot be written.
    """
    library = folder / car_library_name()
    if not library.exists():
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as headers:
            Path(headers, "records.h").write_text(records_header(), "utf-8")
            compile_library(sorted(SOURCES.glob("*.c")), library, Path(headers), OPTIONS)
        remove_others(library, "car")
    return library
