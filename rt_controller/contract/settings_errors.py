"""Messages for settings that pydantic refused: each field by its name, all of them at once."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any

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
    **dict.fromkeys(("float_parsing", "float_type"), "a number"),
    **dict.fromkeys(("bool_parsing", "bool_type"), "true or false"),
    **dict.fromkeys(("dict_type", "model_type", "model_attributes_type"), "a table"),
    **dict.fromkeys(("list_type", "tuple_type"), "a list"),
}
_LISTED_CHARACTERS = 60


def explain(
    refused: Any,
    name_of: Callable[[Location], str],
    known: Callable[[Location], Iterable[str]] = lambda parent: (),
) -> str:
    """One line "NAME: expected …, found …" for each refused field.

    `refused` is a `pydantic.ValidationError`. `name_of` turns the place of a field into the name
    that the user wrote. `known` lists the fields that exist in a place, for a hint where a name is
    misspelt.
    """
    return "\n".join(_line(error, name_of, known) for error in refused.errors())


def dotted(location: Location) -> str:
    """A place as in TOML: ("moves", 1, "length_m") is "moves[1].length_m"."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def option(location: Location) -> str:
    """A place as the command-line option: ("mpc", "horizon") is "--mpc.horizon"."""
    return "--" + dotted(location).replace("_", "-")


def _line(
    error: Mapping[str, Any],
    name_of: Callable[[Location], str],
    known: Callable[[Location], Iterable[str]],
) -> str:
    kind, location = error["type"], tuple(error["loc"])
    name = name_of(location)
    if kind == "extra_forbidden":
        return f"{name}: no such setting.{_hint(location, known)}"
    if kind == "missing":
        return f"{name}: expected a value, found none."
    found = repr(error["input"])
    if len(found) > _LISTED_CHARACTERS:
        found = found[:_LISTED_CHARACTERS] + "…"
    if kind in ("value_error", "assertion_error"):
        reason = str(error["ctx"]["error"]).rstrip(".")
        return f"{name}: {reason}, found {found}."
    expected = _EXPECTED.get(kind)
    if expected is None:
        return f"{name}: {error['msg']}, found {found}."
    return f"{name}: expected {expected.format(**error.get('ctx', {}))}, found {found}."


def _hint(location: Location, known: Callable[[Location], Iterable[str]]) -> str:
    names: Sequence[str] = sorted(known(location[:-1]))
    if not names:
        return ""
    near = get_close_matches(str(location[-1]), names, n=1)
    return f" Did you mean {near[0]}?" if near else f" Known: {', '.join(names)}."
