"""`FunctionSource`: a compiled function with its syntax tree and the names that it sees."""

import ast
import inspect
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from sim_bridge.c_code.refusal import refuse


@dataclass(frozen=True, slots=True)
class FunctionSource:
    """A function of a Python file."""

    file: str
    module: str
    """last part of the module's name"""
    name: str
    tree: ast.FunctionDef
    names: Mapping[str, Any]
    """global names of its module"""
    annotations: Mapping[str, Any]
    """of the parameters and of `return`"""
    defaults: Mapping[str, Any]

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters in order."""
        return [argument.arg for argument in self.tree.args.args]


def is_compiled(thing: Any) -> bool:
    """True for what `sim_bridge.plant.jit.compiled` returns."""
    return hasattr(thing, "py_func")


def source_of(kernel: Any) -> FunctionSource:
    """The source of a compiled function.

    Raises:
        UnsupportedCodeError: its parameters are not plain, or it is nested in another function.
    """
    function = kernel.py_func
    file = inspect.getsourcefile(function) or "<unknown file>"
    tree = _functions(file).get(function.__name__)
    if tree is None or "<locals>" in function.__qualname__:
        refuse(
            file,
            None,
            f"no function {function.__name__} at the top of this file",
            "Define compiled functions at the top level of a module.",
        )
    arguments = tree.args
    if arguments.vararg or arguments.kwarg or arguments.kwonlyargs or arguments.posonlyargs:
        refuse(
            file,
            tree,
            f"parameters with * or / in {function.__name__}",
            "Give it plain parameters.",
        )
    defaults = function.__defaults__ or ()
    names = [argument.arg for argument in arguments.args]
    return FunctionSource(
        file,
        function.__module__.rpartition(".")[2],
        function.__name__,
        tree,
        function.__globals__,
        _annotations(function, file, tree),
        dict(zip(names[len(names) - len(defaults) :], defaults, strict=True)),
    )


def docstring_of(source: FunctionSource) -> str:
    """The docstring without its indentation; empty if there is none."""
    return ast.get_docstring(source.tree) or ""


def body_of(source: FunctionSource) -> list[ast.stmt]:
    """The statements without the docstring."""
    body = source.tree.body
    return body[1:] if ast.get_docstring(source.tree) is not None else body


def _annotations(function: Any, file: str, tree: ast.FunctionDef) -> dict[str, Any]:
    try:
        return typing.get_type_hints(function)
    except NameError as error:
        refuse(
            file,
            tree,
            f"annotations of {function.__name__} that cannot be read: {error}",
            "Import their names at the top of the file, outside `if TYPE_CHECKING`.",
        )


@cache
def _functions(file: str) -> dict[str, ast.FunctionDef]:
    tree = ast.parse(Path(file).read_text(encoding="utf-8"), file)
    return {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
