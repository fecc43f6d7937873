"""Messages for settings that pydantic refused: each field by its name, all of them at once."""

import re
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from itertools import filterfalse, islice
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

from rt_controller.contract.names import hint, near_names

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
    **dict.fromkeys(("dict_type", "model_type", "dataclass_type"), "a table"),
    "model_attributes_type": "a table",
    **dict.fromkeys(("list_type", "tuple_type"), "a list"),
}
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
_LISTED_CHARACTERS, _TEXT_CHARACTERS = 60, 400
"""of a value that was found, and of one that is a text: a long path is shown whole"""
_FIELD_FIRST = re.compile(r"[a-z_0-9]+(\[\d+\]\.[a-z_]+)?: expected")
LISTED_ERRORS = 20
"""the first ones, which is enough of thousands: the hints take milliseconds each"""


def explain(refused: Any, name_of: Callable[[Location], str], table: Any = None) -> str:
    """One line "NAME: expected …, found …" for each refused field, at most `LISTED_ERRORS`.

    Args:
        refused: a `pydantic.ValidationError`.
        name_of: the name that the user wrote for a field at this place.
        table: the pydantic model that refused; knows which fields exist, for a hint where a name
            is misspelt, and for one line where each type of a union was tried.
    """
    errors: dict[Location, list[Mapping[str, Any]]] = {}
    known: dict[Location, list[str]] = {}
    for error in refused.errors():
        if error["type"] == "default_factory_not_called":  # of another field that is refused
            continue
        place, known_here = _locate(tuple(error["loc"]), table)
        errors.setdefault(place, []).append(error)
        known[place] = known_here
    misspelt = {
        (*place[:-1], *near_names(str(place[-1]), known[place]))
        for place, found in errors.items()
        if found[0]["type"] in _UNKNOWN
    }
    errors = {
        place: found
        for place, found in errors.items()
        if found[0]["type"] != "missing" or place not in misspelt
    }
    lines = [
        line
        for place in islice(errors, LISTED_ERRORS)
        for line in _lines(errors[place], name_of(place), known[place])
    ]
    if len(errors) > LISTED_ERRORS:
        lines.append(f"… and {len(errors) - LISTED_ERRORS} more. Correct these first.")
    return "\n".join(lines)


def is_tag(part: str | int) -> bool:
    """True if a part of an error's place is no field: the chosen form of a value, or a key."""
    return isinstance(part, str) and (part.startswith("(") or part == "[key]")


def _lines(errors: Sequence[Mapping[str, Any]], name: str, known: list[str]) -> Iterator[str]:
    """Several for a check of a whole table, which begins each line with the field."""
    error = errors[0]
    if error["type"] != "value_error" or not isinstance(error["input"], Mapping):
        yield _explain_field(errors, name, known)
        return
    for line in str(error["ctx"]["error"]).splitlines():
        separator = "" if not name else "." if _FIELD_FIRST.match(line) else ": "
        yield f"{name}{separator}{line if line.endswith(':') else line.rstrip('.') + '.'}"


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
    """The place without the types of a union at its end, and the fields known beside it."""
    named, place = any(map(is_tag, place)), tuple(filterfalse(is_tag, place))
    fields: dict[str, Any] = {}
    for depth, part in enumerate(place, 1):
        if isinstance(part, int) and get_origin(table) is tuple:
            table = get_args(table)[0]
            continue
        known = getattr(table, "__pydantic_fields__", {})
        fields = {field.alias or name: field for name, field in known.items()}
        if part not in fields:
            fields = {} if depth < len(place) else fields
            break
        table = fields[part].annotation
        if get_origin(table) in (Union, UnionType):
            table, *others = (member for member in get_args(table) if member is not NoneType)
            if others:
                return (place, []) if named else (place[:depth], sorted(fields))
    return place, sorted(fields)


def _explain_field(errors: Sequence[Mapping[str, Any]], name: str, known: list[str]) -> str:
    """The line of a field; several errors are those of the types of a union."""
    texts = [_expected(error) for error in errors]
    # What is wrong with a value of the right type says more than the types themselves.
    error = errors[texts.index(None) if None in texts else 0]
    kind = error["type"]
    if kind in _UNKNOWN:
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
