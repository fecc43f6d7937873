"""What a fit chose or found, for people."""

from typing import NamedTuple


class Finding(NamedTuple):
    """One line of what is known about a fitted rival."""

    name: str
    """with the unit where there is one"""
    value: str
