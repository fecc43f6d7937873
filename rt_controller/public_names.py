"""Public names of a package that are imported when they are first used."""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def public_names(
    package: str, modules: Mapping[str, str]
) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """`__all__`, `__getattr__` and `__dir__` of a package; `__version__` is among its attributes.

    Args:
        package: its `__name__`.
        modules: for each public name the module, below the package, that defines it.
    """

    def get(name: str) -> Any:
        if name in modules:
            return getattr(import_module(f"{package}.{modules[name]}"), name)
        if name == "__version__":
            return import_module("importlib.metadata").version("rt-controller")
        raise AttributeError(
            f"module {package!r} has no attribute {name!r}; its public names are "
            f"{', '.join(sorted(modules))}"
        )

    names = sorted(modules)
    return names, get, lambda: [*names, "__version__"]
