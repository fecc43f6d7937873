"""Messages for a name that is not known."""

from collections.abc import Collection, Sequence
from difflib import get_close_matches

MODEL_FOLDER = "a folder that offline-export wrote"
"""what a model may be that is not a shipped one"""
SHOWN_COLUMNS = 40


def hint(found: str, names: Collection[str]) -> str:
    """ " (did you mean NAME?)" with the name most similar to `found`; empty if none is."""
    near = get_close_matches(found, names, n=1)
    return f" (did you mean {near[0]}?)" if near else ""


def columns_of(holder: str, wanted: str, available: Sequence[str]) -> str:
    """What has to follow "found none of that name": similar columns, and those that there are."""
    lowered = {name.lower(): name for name in available}
    near = [lowered[name] for name in get_close_matches(wanted.lower(), lowered, n=3, cutoff=0.5)]
    similar = f"Did you mean {' or '.join(near)}? " if near else ""
    more = ", …" * (len(available) > SHOWN_COLUMNS)
    return f"{similar}The {holder} has: {', '.join(available[:SHOWN_COLUMNS])}{more}."


def name_or(found: str, names: Collection[str], otherwise: str) -> str:
    """What was expected in place of `found`: one of the names, or something else."""
    return f"expected one of {', '.join(names)}{hint(found, names)}, or {otherwise}"
