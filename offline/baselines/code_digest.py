"""A digest of the code that a fit depends on; comments, docstrings and layout do not count."""

import ast
import hashlib
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from offline.data.code_identity import PACKAGES


def digest_of_code(module: str) -> str:
    """SHA-256 over a module and everything that it imports of these packages, also indirectly."""
    found: dict[str, str] = {}
    left = [module]
    while left:
        name = left.pop()
        if name in found or name.split(".")[0] not in PACKAGES:
            continue
        path = _source_of(name)
        if path is not None:
            found[name], imported = _digest_and_imports(path, path.stat().st_mtime_ns)
            left += imported
    lines = [f"{name} {found[name]}" for name in sorted(found)]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def digest_of_tree(tree: ast.Module) -> str:
    """SHA-256 of what a file does."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            node.body = [line for line in node.body if not _is_docstring(line)]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest()


@cache
def _digest_and_imports(path: Path, mtime_ns: int) -> tuple[str, tuple[str, ...]]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    imported = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            imported += [str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)]
    return digest_of_tree(tree), tuple(imported)


@cache
def _source_of(module: str) -> Path | None:
    """The file of a module; None if the name is that of a function, a class or a package."""
    try:
        spec = find_spec(module)
    except ModuleNotFoundError:
        return None
    is_module = spec is not None and spec.origin is not None and not spec.submodule_search_locations
    return Path(str(spec.origin)) if spec is not None and is_module else None


def _is_docstring(line: ast.stmt) -> bool:
    return (
        isinstance(line, ast.Expr)
        and isinstance(line.value, ast.Constant)
        and isinstance(line.value.value, str)
    )
