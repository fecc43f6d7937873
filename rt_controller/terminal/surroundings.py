"""What a process needs of its surroundings: a working directory, memory, a width for its text."""

import os
import resource
import shutil

from rt_controller.contract.errors import ConfigError

NARROWEST_COLUMNS = 40
"""rich does not end when it has to wrap a help text to two columns"""


def require_surroundings() -> None:
    """Return if there is a working directory; text is never narrower than `NARROWEST_COLUMNS`.

    Raises:
        ConfigError: the working directory was removed.
    """
    if shutil.get_terminal_size().columns < NARROWEST_COLUMNS:
        os.environ["COLUMNS"] = str(NARROWEST_COLUMNS)
    try:
        os.getcwd()
    except FileNotFoundError as error:
        raise ConfigError(
            "Working directory: expected a folder, found that it was removed. Change to another "
            "folder (cd)."
        ) from error


def explain_lack_of_memory(error: BaseException) -> ConfigError | None:
    """The error to show in place of this one; None if it is not for a lack of memory.

    A shared library that does not fit below `ulimit -v` is an error of its import.
    """
    limit_bytes = resource.getrlimit(resource.RLIMIT_AS)[0]
    is_limited = limit_bytes != resource.RLIM_INFINITY
    is_of_library = isinstance(error, ImportError) or (
        isinstance(error, OSError) and error.filename is None
    )
    if not isinstance(error, MemoryError) and not (is_limited and is_of_library):
        return None
    found = f"a limit of {limit_bytes / 2**20:.0f} MiB" if is_limited else "too little"
    text = f" ({str(error).splitlines()[0]})" if str(error) else ""
    return ConfigError(
        f"Memory: expected enough for the program and its libraries, found {found}{text}. Raise "
        f"the limit (ulimit -v), or end other programs."
    )
