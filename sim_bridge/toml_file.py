"""TOML files of the package, and a person's own ones beside them: names and texts."""

from importlib import resources
from pathlib import Path

from rt_controller.contract.errors import ConfigError


def shipped_names(folder: str) -> list[str]:
    """Names of the TOML files in a folder of the package, without `.toml`."""
    files = (resources.files("sim_bridge") / folder).iterdir()
    return sorted(file.name.removesuffix(".toml") for file in files if file.name.endswith(".toml"))


def read_shipped_or_own(name_or_path: str | Path, folder: str, kind: str) -> str:
    """The text of a shipped file by its name, or of any file by a path that ends in `.toml`.

    Args:
        folder: of the package, with the shipped files.
        kind: "car", "scenario": for messages.

    Raises:
        ConfigError: there is no such file.
    """
    name = str(name_or_path)
    if name in shipped_names(folder):
        return (resources.files("sim_bridge") / folder / f"{name}.toml").read_text("utf-8")
    if not name.endswith(".toml"):
        raise ConfigError(
            f"{kind} {name!r}: expected one of {', '.join(shipped_names(folder))} or the path of a "
            f".toml file."
        )
    from rt_controller.contract.files import read_text  # numpy, which --help does without

    try:
        return read_text(Path(name))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{name}: expected a {kind} file in UTF-8 that can be read, found an error: {error}. "
            f"Correct the file, or name another one."
        ) from error
