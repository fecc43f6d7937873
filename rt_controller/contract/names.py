"""Messages for a name that is not known."""

from collections.abc import Collection
from difflib import get_close_matches

MODEL_FOLDER = "a folder that offline-export wrote"
"""what a model may be that is not a shipped one"""


def hint(found: str, names: Collection[str]) -> str:
    """ " (did you mean NAME?)" with the name most similar to `found`; empty if none is."""
    near = get_close_matches(found, names, n=1)
    return f" (did you mean {near[0]}?)" if near else ""


def name_or(found: str, names: Collection[str], otherwise: str) -> str:
    """What was expected in place of `found`: one of the names, or something else."""
    return f"expected one of {', '.join(names)}{hint(found, names)}, or {otherwise}"
