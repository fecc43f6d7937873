"""Controllers by name: the MPC with a model, a baseline, or a control law of one's own."""

import sys
import traceback
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
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
            f"--controller: expected one of {', '.join(known)}, the folder of a bundle, or "
            f"{OWN_LAW}, found {name!r}{hint(name, known)}."
        )
    module = _import(name, module_name)
    found: Any = getattr(module, attribute, None)
    if found is None:
        raise ConfigError(
            f"--controller {name}: expected a class {attribute} in {module_name}, found none"
            f"{hint(attribute, dir(module))}."
        )
    try:
        law = found() if isinstance(found, type) else found
    except Exception as error:
        raise ConfigError(
            f"--controller {name}: expected a class that needs no arguments, found that it raises "
            f"{explain_exception(error)}."
        ) from error
    return require_law(law, f"--controller {name}")


def law_file(name: str) -> Path | None:
    """The file that defines a law; None if it is not known."""
    module_name = BASELINES.get(name, name).rpartition(":")[0]
    if module_name.endswith(".py"):
        return Path(module_name)
    file = _import(name, module_name).__file__
    return None if file is None else Path(file)


def require_law(found: object, name: str = "controller") -> ControlLaw:
    """The same object, as a control law.

    Raises:
        ConfigError: it has no method `control`.
    """
    if not callable(getattr(found, "control", None)):
        raise ConfigError(
            f"{name}: expected an object with a method control(now), as of rt_controller."
            f"ControlLaw, found {type(found).__name__} without one."
        )
    return cast("ControlLaw", found)


def _import(name: str, module_name: str) -> ModuleType:
    try:
        if not module_name.endswith(".py"):
            folder = str(Path.cwd())
            if folder not in sys.path:
                sys.path.insert(0, folder)
            return import_module(module_name)
        spec = spec_from_file_location(Path(module_name).stem, module_name)
        if spec is None or spec.loader is None:
            raise ImportError(f"no Python file {module_name}")
        module = module_from_spec(spec)
        spec.loader.exec_module(module)
    except (ImportError, OSError) as error:
        raise ConfigError(
            f"--controller {name}: expected a Python module, found: {error}. Name it as {OWN_LAW}."
        ) from error
    except Exception as error:
        raise ConfigError(
            f"--controller {name}: expected a module that can be imported, found that it raises "
            f"{explain_exception(error)}."
        ) from error
    return module


def explain_exception(error: BaseException) -> str:
    """Type, message and last place of an exception, for people."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
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
