"""`sim-bridge export-fmu`: the own car as an FMU, for other people's tools."""

import shutil
import tempfile
from importlib import resources
from pathlib import Path
from typing import Any

from rich.console import Console

from rt_controller.contract.errors import ConfigError, MissingExtraError
from rt_controller.contract.signals import ControlInput
from sim_bridge.adapters.fmu_mapping import mapping_beside
from sim_bridge.adapters.plants import DEFAULT_CAR
from sim_bridge.plant.integrate import STEP_S
from sim_bridge.plant.parameters import load_parameters, shipped_cars
from sim_bridge.plant.protocol import PlantOutputs

_SCRIPT = "rt_controller_car.py"
"""the module's name inside the FMU; it shares a Python with whatever loads it"""


def export_fmu(
    file: Path = Path("car.fmu"),
    *,
    car: str = DEFAULT_CAR,
) -> None:
    """Build an FMU of the own car (FMI 2 co-simulation), with its mapping file beside it.

    Whoever loads the FMU needs a Python with rt-controller[sim]; the car's parameters are inside.

    Parameters
    ----------
    file
        where to write the FMU
    car
        the car's parameters: a shipped name, or the path of a .toml file
    """
    mapping = build_fmu(file, car)
    Console(stderr=True).print(
        f"{file} and {mapping} written. Try: sim-bridge --bus … --plant fmu:{file}",
        highlight=False,
        soft_wrap=True,
    )


def build_fmu(file: Path, car: str = DEFAULT_CAR) -> Path:
    """Write the FMU and return where its mapping file lies.

    Raises:
        MissingExtraError: pythonfmu is not installed.
        ConfigError: there is no such car, or the file cannot be written.
    """
    builder = _builder()
    if file.suffix != ".fmu":
        raise ConfigError(f"{file}: expected a name that ends in .fmu. Choose one, as in car.fmu.")
    load_parameters(car)
    mapping = mapping_beside(file)
    if car not in shipped_cars() and mapping.resolve() == Path(car).resolve():
        raise ConfigError(
            f"{file}: expected room for its mapping in {mapping}, found the car file there. Choose "
            f"another name for the FMU."
        )
    with tempfile.TemporaryDirectory(prefix="export-fmu-") as folder:
        script = Path(folder) / _SCRIPT
        source = resources.files("sim_bridge") / "adapters" / "fmu_slave.py"
        script.write_text(source.read_text(encoding="utf-8"), encoding="utf-8")
        inside = Path(folder) / "car.toml"
        inside.write_text(_car_text(car), encoding="utf-8")
        built = Path(folder) / "built.fmu"
        builder.build_FMU(script, dest=built, project_files=[inside], needsExecutionTool="true")
        try:
            shutil.copy(built, file)
            mapping.write_text(mapping_text(), encoding="utf-8")
        except OSError as error:
            raise ConfigError(
                f"{file}: expected a place that can be written to, found {error.strerror}. Choose "
                f"another."
            ) from error
    return mapping


def mapping_text() -> str:
    """The mapping file of an exported FMU."""
    lines = [
        "# Which variable of the FMU is which signal of the contract.",
        f"communication_step_s = {STEP_S}",
        "",
        "[inputs]",
        *(f'{name} = "{name}"' for name in ControlInput._fields),
        "",
        "[outputs]",
        *(f'{name} = "{name}"' for name in ("vx_mps", "vy_mps", "yaw_rate_radps")),
        *(f'{name} = "seen_{name}"' for name in PlantOutputs._fields),
        "",
        "[start]",
        'vx_mps = "v0_mps"',
        'road_friction = "road_friction"',
    ]
    return "\n".join(lines) + "\n"


def _car_text(car: str) -> str:
    if car in shipped_cars():
        return (resources.files("sim_bridge") / "cars" / f"{car}.toml").read_text("utf-8")
    return Path(car).read_text("utf-8")


def _builder() -> Any:
    try:
        from pythonfmu import FmuBuilder
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"export-fmu needs {error.name}: expected the extra [fmu], found it missing. Install "
            f'it with: pip install -e ".[fmu]"'
        ) from error
    return FmuBuilder
