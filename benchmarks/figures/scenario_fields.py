"""Tables of docs/reference/scenario-fields.md, made from the classes of a scenario file."""

import ast
import inspect
from collections.abc import Iterator
from itertools import pairwise
from math import isfinite
from textwrap import dedent
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from sim_bridge.scenario import Scenario
from sim_bridge.scenario.table import Table
from sim_bridge.scenario.values import Written
from sim_bridge.toml_file import FileTable

HEADS = ("field", "limits", "default", "meaning")
"""of `field_rows`"""


class Entry(NamedTuple):
    """A field that holds no further table."""

    name: str
    limits: str
    default: str
    meaning: str
    written: Written | None


def entries(table: Any = Scenario, prefix: str = "") -> Iterator[Entry]:
    """Each field of a class, those of the tables inside it included."""
    meanings = _docstrings(table)
    for key, field in table.__pydantic_fields__.items():
        kind, notes = _parts_of(field.annotation, list(field.metadata))
        is_list = get_origin(kind) is tuple
        inner = get_args(kind)[0] if is_list else kind
        written = next((note for note in notes if isinstance(note, Written)), None)
        name = f"{prefix}{field.alias or key}"
        if written is None and isinstance(inner, type) and issubclass(inner, FileTable):
            yield from entries(inner, f"{name}{'[]' * is_list}.")
            continue
        limits = _limits(kind, notes) if written is None else written.limits
        yield Entry(name, limits, _default(field.default), meanings.get(key, ""), written)


def field_rows() -> Iterator[tuple[str, ...]]:
    """Name, limits, default and meaning of each field."""
    for name, limits, default, meaning, written in entries():
        forms = "" if written is None else written.forms
        yield f"`{name}`", limits, default, "; ".join(filter(None, (forms, meaning)))


def kind_rows() -> Iterator[tuple[str, ...]]:
    """Each kind of a value, and its fields with their limits and defaults."""
    written = [entry.written for entry in entries() if entry.written]
    for kind, table in (item for each in written for item in each.tables.items()):
        if "kind" not in table.model_fields:  # knots
            continue
        fields = (
            " ".join(filter(None, (f"`{name}`", limits, default and f"({default})")))
            for name, limits, default, *_ in entries(table)
            if name != "kind"
        )
        yield f"`{kind}`", ", ".join(fields)


def _docstrings(table: Any) -> dict[str, str]:
    """The text below each field in the source of a class."""
    source = ast.walk(ast.parse(dedent(inspect.getsource(table))))
    lines = next(node for node in source if isinstance(node, ast.ClassDef)).body
    return {
        ast.unparse(line.target): " ".join(ast.literal_eval(below.value).split())
        for line, below in pairwise(lines)
        if isinstance(line, ast.AnnAssign) and isinstance(below, ast.Expr)
    }


def _parts_of(kind: Any, notes: list[Any]) -> tuple[Any, list[Any]]:
    """A type without None and notes, and all its notes."""
    while True:
        if get_origin(kind) is Annotated:
            kind, *more = get_args(kind)
            for note in more:
                notes += note.metadata if isinstance(note, FieldInfo) else [note]
        elif get_origin(kind) in (Union, UnionType) and NoneType in get_args(kind):
            kind = next(member for member in get_args(kind) if member is not NoneType)
        else:
            return kind, notes


def _limits(kind: Any, notes: list[Any]) -> str:
    if get_origin(kind) is Literal:
        return ", ".join(map(str, get_args(kind)))
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    bounds = {name: getattr(note, name) for note in notes for name in signs if hasattr(note, name)}
    if bounds.keys() == {"ge", "le"}:
        low, high = bounds["ge"], bounds["le"]
        return f"±{high:g}" if low == -high else f"{low:.9g}..{high:.9g}"
    return ", ".join(f"{signs[name]} {bound:.9g}" for name, bound in bounds.items())


def _default(value: Any) -> str:
    if isinstance(value, Table):
        return f"{value.at(0.0):g}"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float) and isfinite(value):
        return f"{value:g}"
    return value if isinstance(value, str) else ""
