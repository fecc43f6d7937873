"""Messages for settings that pydantic refused: each field by its name, all of them at once."""

import re
from collections.abc import Callable, Container, Mapping, Sequence
from itertools import islice
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from rt_controller.contract.names import hint

Location = tuple[str | int, ...]
"""path of a field inside the settings: ("mpc", "tolerance", "ey_m")"""


_EXPECTED = {
    "greater_than": "more than {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "less than {lt}",
    "less_than_equal": "at most {le}",
    "finite_number": "a finite number",
    "too_short": "at least {min_length} entries",
    "too_long": "at most {max_length} entries",
    "string_too_short": "a text that is not empty",
    "string_type": "a text",
    "path_type": "a path",
    **dict.fromkeys(("literal_error", "enum"), "{expected}"),
    **dict.fromkeys(("int_parsing", "int_type", "int_from_float"), "an integer"),
    "int_parsing_size": "an integer of fewer digits",
    **dict.fromkeys(("float_parsing", "float_type"), "a number"),
    **dict.fromkeys(("bool_parsing", "bool_type"), "true or false"),
    **dict.fromkeys(
        ("dict_type", "model_type", "model_attributes_type", "dataclass_type"), "a table"
    ),
    **dict.fromkeys(("list_type", "tuple_type"), "a list"),
}
_LISTED_CHARACTERS, _TEXT_CHARACTERS = 60, 400
"""of a value that was found, and of one that is a text: a long path is shown whole"""
_FIELD_FIRST = re.compile(r"[\w.\[\]]+: expected")
"""a line of a check of a whole table"""
LISTED_ERRORS = 20
"""the first ones, which is enough of thousands: the hints take milliseconds each"""


def explain(refused: Any, name_of: Callable[[Location], str], table: Any = None) -> str:
    """One line "NAME: expected …, found …" for each refused field, at most `LISTED_ERRORS` of them.

    Args:
        refused: a `pydantic.ValidationError`.
        name_of: the name that the user wrote for a field at this place.
        table: the pydantic class that refused; knows which fields exist, for a hint where a name
            is misspelt, and for one line where each type of a union was tried.
    """
    errors: dict[Location, list[Mapping[str, Any]]] = {}
    known: dict[Location, list[str]] = {}
    for error in refused.errors():
        if error["type"] == "default_factory_not_called":  # since another field was refused
            continue
        place, known_here = _locate(tuple(error["loc"]), table)
        errors.setdefault(place, []).append(error)
        known[place] = known_here
    lines = [
        line
        for place in islice(errors, LISTED_ERRORS)
        for line in _explain_place(errors[place], place, name_of, known[place])
    ]
    if len(errors) > LISTED_ERRORS:
        lines.append(f"… and {len(errors) - LISTED_ERRORS} more. Correct these first.")
    return "\n".join(lines)


def dotted(location: Location) -> str:
    """A place as in TOML: ("moves", 1, "length_m") is "moves[1].length_m"."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def option(location: Location) -> str:
    """A place as the command-line option: ("mpc", "horizon") is "--mpc.horizon"."""
    return "--" + dotted(location).replace("_", "-")


def with_options(message: str, options: Container[str]) -> str:
    """The message with `mpc.horizon` as --mpc.horizon, if that is one of the options."""

    def as_option(found: re.Match[str]) -> str:
        name = option((found[1],))
        return name if name in options else found[0]

    return re.sub(r"`([a-z_.]+)`", as_option, message)


def _locate(place: Location, table: Any) -> tuple[Location, list[str]]:
    """The place without the types and tags of a union, and the fields known beside it."""
    shown = tuple(part for part in place if not str(part).startswith(("(", "[")))
    tables: Mapping[str, Any] = {}
    fields: dict[str, Any] = {}
    for depth, part in enumerate(place, 1):
        if part in tables:
            table = tables[str(part)]
        elif not isinstance(part, int):  # the type of an entry is already that of its list
            known = getattr(table, "__pydantic_fields__", {})
            fields = {field.alias or name: field for name, field in known.items()}
            if part not in fields:
                break
            table, tables, is_union = _type_of(fields[str(part)])
            if is_union:
                return place[:depth], sorted(fields)
    return shown, sorted(fields)


def _type_of(field: Any) -> tuple[Any, Mapping[str, Any], bool]:
    """Type of a field or of its entries, its tables by their tags, and whether it is a union."""
    kind, notes = field.annotation, list(field.metadata)
    while True:
        tagged: Mapping[str, Any]
        tagged = next((note.by_tag for note in notes if hasattr(note, "by_tag")), {})
        origin, members = get_origin(kind), [m for m in get_args(kind) if m is not NoneType]
        is_union = origin in (Union, UnionType)
        if tagged or (is_union and len(members) > 1):
            return kind, tagged, not tagged
        if not is_union and origin not in (Annotated, list, tuple):
            return kind, {}, False
        kind, *notes = members


def _explain_place(
    errors: Sequence[Mapping[str, Any]],
    place: Location,
    name_of: Callable[[Location], str],
    known: list[str],
) -> list[str]:
    """The line of a field; a check of a whole table has one for each field that it names."""
    error, name = errors[0], name_of(place)
    if error["type"] == "value_error" and isinstance(error["input"], Mapping):
        reasons = str(error["ctx"]["error"]).splitlines()
        if not name:
            return reasons
        if all(_FIELD_FIRST.match(reason) for reason in reasons):
            parts = (reason.rstrip(".").partition(": ") for reason in reasons)
            return [f"{name_of((*place, field))}: {text}." for field, _, text in parts]
    return [_explain_field(errors, name, known)]


def _explain_field(errors: Sequence[Mapping[str, Any]], name: str, known: list[str]) -> str:
    """The line of a field; several errors are those of the types of a union."""
    texts = [_expected(error) for error in errors]
    # What is wrong with a value of the right type says more than the types themselves.
    error = errors[texts.index(None) if None in texts else 0]
    kind = error["type"]
    if kind in ("extra_forbidden", "unexpected_keyword_argument"):
        near = hint(str(error["loc"][-1]), known)
        listed = f" Known: {', '.join(known)}." if known and not near else ""
        return f"{name}: no such setting{near}.{listed}"
    if kind == "missing":
        return f"{name}: expected a value, found none."
    found = repr(error["input"])
    longest = _TEXT_CHARACTERS if isinstance(error["input"], str) else _LISTED_CHARACTERS
    if len(found) > longest:
        found = found[:longest] + "…"
    if kind in ("value_error", "assertion_error"):
        reason = str(error["ctx"]["error"]).rstrip(".")
        # A check that states itself what it found knows more than the whole input.
        return f"{name}: {reason}." if "found" in reason else f"{name}: {reason}, found {found}."
    if None in texts:
        return f"{name}: {error['msg']}, found {found}."
    expected = ", or ".join(dict.fromkeys(filter(None, texts)))
    return f"{name}: expected {expected}, found {found}."


def _expected(error: Mapping[str, Any]) -> str | None:
    text = _EXPECTED.get(error["type"])
    return text and text.format(**error.get("ctx", {}))
