"""`FunctionCode`: a translated function."""

from collections.abc import Mapping
from dataclasses import dataclass

from sim_bridge.c_code.c_types import CType


@dataclass(frozen=True, slots=True)
class FunctionCode:
    """A function in C, and what its callers have to know."""

    name: str
    signature: str
    """without the semicolon of a declaration"""
    body: str
    comment: str
    kinds: tuple[CType, ...]
    """types of the parameters"""
    returned: CType
    returned_roots: frozenset[str]
    """parameters and storage that a returned array refers to"""
    written: frozenset[str]
    """parameters whose arrays it writes to"""
    storage: Mapping[str, int]
    """further parameters: memory for arrays that it makes and returns, with their lengths"""
