"""`field_notes`: the docstring of each field of a named tuple, and the limits of its numbers."""

import ast
import inspect
import textwrap
import typing
from functools import cache
from math import inf, nextafter
from typing import Any, NamedTuple

from pydantic.fields import FieldInfo


class Limits(NamedTuple):
    """Which values a number may have."""

    lower: float = -inf
    upper: float = inf
    excludes_lower: bool = False


@cache
def field_notes(kind: type) -> dict[str, str]:
    """By field: its docstring on one line; fields without one are left out."""
    [tree] = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef)
    notes: dict[str, str] = {}
    for field, note in zip(tree.body, tree.body[1:], strict=False):
        if not (isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)):
            continue
        if isinstance(note, ast.Expr) and isinstance(note.value, ast.Constant):
            notes[field.target.id] = " ".join(str(note.value.value).split())
    return notes


def limits_of(kind: type, field: str) -> Limits:
    """Limits of a field, or of the items of a tuple, from its annotation."""
    hint = typing.get_type_hints(kind, include_extras=True)[field]
    return _limits(hint, Limits())


def _limits(hint: Any, limits: Limits) -> Limits:
    if typing.get_origin(hint) is not typing.Annotated:
        items = typing.get_args(hint)
        return _limits(items[0], limits) if items else limits
    inner, *notes = typing.get_args(hint)
    for note in notes:
        for part in note.metadata if isinstance(note, FieldInfo) else [note]:
            if hasattr(part, "gt"):
                limits = limits._replace(lower=float(part.gt), excludes_lower=True)
            if hasattr(part, "ge"):
                limits = limits._replace(lower=float(part.ge), excludes_lower=False)
            if hasattr(part, "le"):
                limits = limits._replace(upper=float(part.le))
            if hasattr(part, "lt"):
                limits = limits._replace(upper=nextafter(float(part.lt), -inf))
    return _limits(inner, limits)
