"""Controllers by name: the MPC with a model, a baseline, or a control law of one's own."""

import sys
import traceback
from hashlib import sha256
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from inspect import signature
from pathlib import Path
from types import ModuleType
from typing import Any, cast, get_args

from rt_controller.config import ShippedModel
from rt_controller.contract.errors import ConfigError, ControlLawError
from rt_controller.contract.names import hint
from rt_controller.control.law import ControlLaw, LawPlanner
from rt_controller.control.planner import Planner

BASELINES = {
    "stanley": "rt_controller.baselines.stanley:Stanley",
    "bicycle-mpc": "rt_controller.baselines.bicycle_mpc:BicycleMpc",
}
"""control laws that need no learned model, by name"""
OWN_LAW = "MODULE:CLASS or FILE.py:CLASS"
PACKAGE = Path(__file__).parent


def open_law(name: str) -> ControlLaw:
    """A baseline by its name, or an instance of a class: MODULE:CLASS, or FILE.py:CLASS.

    A module is looked for in the current folder first.

    Raises:
        ConfigError: there is no such law, its module or constructor raises an exception, or it has
            no method `control`.
    """
    module_name, colon, attribute = BASELINES.get(name, name).rpartition(":")
    if not (module_name and colon):
        models = get_args(ShippedModel)
        known = [*models, *BASELINES]
        raise ConfigError(
            f"controller: expected one of {', '.join(known)}, the folder of a bundle, or "
            f"{OWN_LAW}, found {name!r}{hint(name, known)}."
        )
    module = _import(name, module_name)
    found: Any = getattr(module, attribute, None)
    if found is None:
        raise ConfigError(
            f"controller {name}: expected a class {attribute} in {module_name}, found none"
            f"{hint(attribute, dir(module))}."
        )
    try:
        law = found() if isinstance(found, type) else found
    except Exception as error:
        raise ConfigError(
            f"controller {name}: expected a class that needs no arguments, found that it raises "
            f"{explain_exception(error)}."
        ) from error
    return require_law(law, f"controller {name}")


def law_files(name: str) -> list[Path]:
    """The files that define a law; of a baseline all of them."""
    if name in BASELINES:
        return sorted((PACKAGE / "baselines").glob("*.*"))
    module_name = name.rpartition(":")[0]
    if module_name.endswith(".py"):
        return [Path(module_name)]
    file = _import(name, module_name).__file__
    return [] if file is None else [Path(file)]


def law_digest(name: str | None) -> str:
    """SHA-256 of the files of a law; empty: there is none."""
    content = b"".join(file.read_bytes() for file in law_files(name)) if name else b""
    return sha256(content).hexdigest() if content else ""


def absolute_name(name: str) -> str:
    """The same law, named from any folder where it is FILE.py:CLASS."""
    file, _, attribute = name.rpartition(":")
    return f"{Path(file).resolve()}:{attribute}" if file.endswith(".py") else name


def require_law(found: object, name: str = "controller") -> ControlLaw:
    """The same object, as a control law.

    Raises:
        ConfigError: it is a class, or has no method `control` of one argument.
    """
    if isinstance(found, type):
        raise ConfigError(
            f"{name}: expected an object, found the class {found.__name__}. Write "
            f"{found.__name__}()."
        )
    control = getattr(found, "control", None)
    if not callable(control):
        raise ConfigError(
            f"{name}: expected an object with a method control(now), as of rt_controller."
            f"ControlLaw, found {type(found).__name__} without one."
        )
    try:
        signature(control).bind(object())
    except TypeError as error:
        raise ConfigError(
            f"{name}: expected a method control(now), found that one argument does not fit it "
            f"({error})."
        ) from None
    except ValueError:  # a function that is not written in Python
        pass
    return cast("ControlLaw", found)


def _import(name: str, module_name: str) -> ModuleType:
    """The module; other modules are looked for beside its file, or in the current folder."""
    is_file = module_name.endswith(".py")
    folder = str(Path(module_name).resolve().parent if is_file else Path.cwd())
    if folder not in sys.path:
        sys.path.insert(0, folder)
    try:
        if not is_file:
            return import_module(module_name)
        spec = spec_from_file_location(f"control_law_{Path(module_name).stem}", module_name)
        if spec is None or spec.loader is None:
            raise ImportError(f"no Python file {module_name}")
        module = sys.modules[spec.name] = module_from_spec(spec)  # dataclasses look there
        spec.loader.exec_module(module)
    except Exception as error:
        raise ConfigError(
            f"controller {name}: expected a Python module that can be imported, found "
            f"{explain_exception(error)}. Name it as {OWN_LAW}."
        ) from error
    return module


def explain_exception(error: BaseException) -> str:
    """Type and message of an exception, and its last place in code of the user, for people."""
    place = ""
    for frame in traceback.extract_tb(error.__traceback__):
        file = Path(frame.filename)
        is_own = PACKAGE not in file.parents and "site-packages" not in file.parts
        if is_own and not frame.filename.startswith("<"):
            place = f" ({file.name}, line {frame.lineno})"
    return f"{type(error).__name__}: {error}{place}"


def law_error(planner: Planner) -> ControlLawError | None:
    """The error of a law that gave no input in the drive; None: it gave one in each period."""
    failure = planner.failure if isinstance(planner, LawPlanner) else None
    if failure is None:
        return None
    error = ControlLawError(
        f"the controller {planner.name}: expected an input in each period, found "
        f"{explain_exception(failure)}. Correct its method `control`."
    )
    error.__cause__ = failure
    return error
