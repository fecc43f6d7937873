"""TOML files of the package, and a person's own ones beside them: names, texts, field types."""

from importlib import resources
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.names import hint
from rt_controller.mapping.toml_file import read_own

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]


class FileTable(BaseModel):
    """A table of a TOML file; unknown fields are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def entries(least: int, most: int = 10_000) -> BeforeValidator:
    """Refuse a list of fewer or more entries, before any is read.

    pydantic's own limits read all of them, and count those only that it does not refuse.
    """

    def check(found: Any) -> Any:
        if isinstance(found, list | tuple) and not least <= len(found) <= most:
            raise ValueError(f"expected {least} to {most} entries, found {len(found)}")
        return found

    return BeforeValidator(check)


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
    if not name.lower().endswith(".toml"):
        shipped = shipped_names(folder)
        raise ConfigError(
            f"{kind} {name!r}: expected one of {', '.join(shipped)} or the path of a "
            f".toml file{hint(name, shipped)}."
        )
    return read_own(name, kind)
