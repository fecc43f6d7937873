"""Checks of all offline commands before the work: installed packages, writable files.

A command module holds the options of one command and imports everything heavy inside its
functions, so that `--help` and refused options need neither torch nor numba nor onnx.
"""

from importlib.util import find_spec
from pathlib import Path

from rt_controller.contract.errors import MissingExtraError, install_command
from rt_controller.contract.figures import require_writable

OFFLINE_PACKAGES = ("torch", "numba", "onnx", "onnxscript", "joblib", "onnxruntime")


def require_ready(json_file: Path | None) -> None:
    """Raise before the work starts what would otherwise be raised after it.

    Raises:
        MissingExtraError: a package of the extra `offline` is not installed.
        ConfigError: the JSON file cannot be written.
    """
    require_extra("offline", *OFFLINE_PACKAGES)
    require_writable(json_file)


def require_extra(extras: str, *packages: str) -> None:
    """Return if all packages are installed.

    Args:
        extras: extras of this distribution to install, such as "offline,tune".
        packages: import names.

    Raises:
        MissingExtraError: one is missing.
    """
    missing = [name for name in packages if find_spec(name) is None]
    if missing:
        raise MissingExtraError(
            f"expected the packages of the extra [{extras}], found no {', '.join(missing)}. "
            f"Run: {install_command(extras)}"
        )
