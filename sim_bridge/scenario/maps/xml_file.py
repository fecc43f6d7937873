"""XML files of maps, from which document types are refused.

Entities of a document type could fill the memory or name other files; maps need none.
"""

from math import nan
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, TreeBuilder, XMLParser

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import open_regular

LARGEST_MB = 128
"""size of a file; its tree takes about ten times as much memory"""
LARGEST_NUMBER = 1e9
"""of coordinates and coefficients; the products of larger ones could overflow"""


class _Builder(TreeBuilder):
    """A tree without a document type."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Refuse the file."""
        raise ValueError("no <!DOCTYPE> expected, found one; remove it")


def read_xml(path: Path, expected: str) -> Element:
    """The root of the tree of a file.

    Args:
        path: the file.
        expected: what messages name as expected.

    Raises:
        ConfigError: the file cannot be read, is no XML, is too large, or has a document type.
    """
    try:
        with open_regular(path, LARGEST_MB * 1_000_000) as file:
            return ElementTree.parse(file, XMLParser(target=_Builder())).getroot()
    except OSError as error:
        raise ConfigError(f"{path}: expected {expected}, found: {error.strerror}.") from error
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise ConfigError(f"{path}: expected {expected}, found an error: {error}.") from error


def number(text: str | None, name: str) -> float:
    """The number in a text; `name` is what messages call it.

    Raises:
        ValueError: there is none, or it is not finite, or larger than `LARGEST_NUMBER`.
    """
    try:
        value = float(text or "")
    except ValueError:
        value = nan
    if not abs(value) <= LARGEST_NUMBER:
        found = "none" if text is None else repr(text)
        raise ValueError(
            f"a number of at most {LARGEST_NUMBER:g} expected as {name}, found {found}"
        )
    return value
