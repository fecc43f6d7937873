"""Tables of docs/reference/scenario-fields.md, made from the classes of a scenario file."""

import ast
import inspect
from collections.abc import Iterator
from itertools import pairwise
from math import isfinite
from textwrap import dedent
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo

from sim_bridge.scenario import Scenario
from sim_bridge.scenario.table import Table
from sim_bridge.scenario.values import Knots, Written
from sim_bridge.toml_file import FileTable

Row = tuple[str, str, str, str]
"""field, limits, default and meaning"""


def rows(table: Any = Scenario, prefix: str = "") -> Iterator[Row]:
    """A row for each field of a class, those of the tables inside it included."""
    meanings = _docstrings(table)
    for key, field in table.__pydantic_fields__.items():
        kind, notes = _parts_of(field.annotation, list(field.metadata))
        is_list = get_origin(kind) is tuple
        inner = get_args(kind)[0] if is_list else kind
        written = next((note for note in notes if isinstance(note, Written)), None)
        name = f"{prefix}{field.alias or key}"
        if isinstance(inner, type) and issubclass(inner, FileTable) and written is None:
            yield from rows(inner, f"{name}{'[]' * is_list}.")
            continue
        meaning = [meanings.get(key, "")]
        if written is not None:
            meaning.insert(0, _forms(written))
        limits = _limits(kind, notes) if written is None else written.limits
        yield f"`{name}`", limits, _default(field.default), "; ".join(filter(None, meaning))


def kinds() -> Iterator[tuple[str, str]]:
    """A row for each kind of a value, with its fields, their limits and defaults."""
    for table in dict.fromkeys(
        table
        for holder in (Scenario, *_held(Scenario))
        for field in holder.__pydantic_fields__.values()
        for note in _parts_of(field.annotation, list(field.metadata))[1]
        if isinstance(note, Written)
        for table in note.tables
        if not issubclass(table, Knots)
    ):
        names = get_args(table.model_fields["kind"].annotation)
        fields = (
            " ".join(filter(None, (name, limits, default and f"({default})")))
            for name, limits, default, _ in rows(table)
            if name != "`kind`"
        )
        yield ", ".join(f"`{name}`" for name in names), ", ".join(fields)


def _held(table: Any) -> Iterator[Any]:
    for field in table.__pydantic_fields__.values():
        kind, _ = _parts_of(field.annotation, [])
        if isinstance(kind, type) and issubclass(kind, FileTable):
            yield kind


def _docstrings(table: Any) -> dict[str, str]:
    """The text below each field in the source of a class."""
    source = ast.walk(ast.parse(dedent(inspect.getsource(table))))
    lines = next(node for node in source if isinstance(node, ast.ClassDef)).body
    found = {}
    for line, below in pairwise(lines):
        if isinstance(line, ast.AnnAssign) and isinstance(below, ast.Expr):
            found[ast.unparse(line.target)] = " ".join(ast.literal_eval(below.value).split())
    return found


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
    bounds = {
        name: getattr(note, name)
        for note in notes
        for name in ("gt", "ge", "lt", "le")
        if hasattr(note, name)
    }
    if bounds.keys() == {"ge", "le"}:
        low, high = bounds["ge"], bounds["le"]
        return f"±{high:g}" if low == -high else f"{low:.9g}..{high:.9g}"
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    return ", ".join(f"{signs[name]} {bound:.9g}" for name, bound in bounds.items())


def _default(value: Any) -> str:
    if isinstance(value, Table):
        return f"{value.at(0.0):g}"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float) and isfinite(value):
        return f"{value:g}"
    return value if isinstance(value, str) else ""


def _forms(written: Written) -> str:
    """What a file may write for a value along the drive."""
    axes = " or ".join(f"`{table.axis}`" for table in written.tables if issubclass(table, Knots))
    named = [f"`{tag[1:-1]}`" for tag, table in written.by_tag.items()
             if not issubclass(table, Knots)]  # fmt: skip
    return ", ".join(("number", f"table over {axes}", *named))
