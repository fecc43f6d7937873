"""`UnsupportedCodeError`: Python code that has no translation to C, with its place and a remedy."""

import ast
from pathlib import Path
from typing import NoReturn

from rt_controller.contract.errors import RtControllerError


class UnsupportedCodeError(RtControllerError):
    """A compiled function uses something that the translation to C does not cover."""


def refuse(file: str, node: ast.AST | None, found: str, remedy: str) -> NoReturn:
    """Raise the error for a piece of code.

    Raises:
        UnsupportedCodeError: always.
    """
    line = getattr(node, "lineno", 0)
    raise UnsupportedCodeError(
        f"{Path(file).name}, line {line} ({file}): expected code that can be translated to C, "
        f"found {found}. {remedy}"
    )
