"""`sim-bridge export-fmu`: the own car as an FMU in C for other tools."""

from pathlib import Path
from typing import Literal

from rich.console import Console

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import write_text
from sim_bridge.plant.shipped_cars import DEFAULT_CAR, shipped_cars


def export_fmu(file: Path, car: str, fmi: Literal[2, 3]) -> None:
    """Build the FMU and say on stderr how to drive it."""
    mapping = build_fmu(file, car, fmi)
    Console(stderr=True).print(
        f"{file} and {mapping} written. Try: sim-bridge --bus … --plant fmu:{file}",
        highlight=False,
        soft_wrap=True,
    )


def build_fmu(file: Path, car: str = DEFAULT_CAR, fmi: Literal[2, 3] = 2) -> Path:
    """Write the FMU; returns the path of its mapping file.

    Raises:
        MissingExtraError: there is no C compiler.
        ConfigError: there is no such car, or the file cannot be written.
    """
    from sim_bridge.fmu_export.archive import mapping_text, write_fmu
    from sim_bridge.fmu_export.description import FmiVersion

    if file.suffix != ".fmu":
        raise ConfigError(f"{file}: expected a name that ends in .fmu. Choose one, as in car.fmu.")
    mapping = file.with_suffix(".toml")
    if car not in shipped_cars() and mapping.resolve() == Path(car).resolve():
        raise ConfigError(
            f"{file}: expected that its mapping can be written to {mapping}, found the car file "
            f"there. Choose another name for the FMU."
        )
    write_fmu(file, car, FmiVersion(fmi))
    write_text(mapping, mapping_text())
    return mapping
