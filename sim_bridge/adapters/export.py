"""`sim-bridge export-fmu`: the own car as an FMU for other tools."""

import shutil
import tempfile
from importlib import resources
from pathlib import Path

from rich.console import Console

from rt_controller.contract.errors import ConfigError, needs_extra
from rt_controller.contract.signals import ControlInput
from sim_bridge.plant.integrate import STEP_S
from sim_bridge.plant.parameters import CARS_FOLDER, DEFAULT_CAR, load_parameters, shipped_cars
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs
from sim_bridge.toml_file import read_shipped_or_own

_SCRIPT = "rt_controller_car.py"
"""name of the module inside the FMU; it runs in the Python of the process that loads the FMU"""


def export_fmu(file: Path, car: str) -> None:
    """Write the FMU and say on stderr how to drive it."""
    mapping = build_fmu(file, car)
    Console(stderr=True).print(
        f"{file} and {mapping} written. Try: sim-bridge --bus … --plant fmu:{file}",
        highlight=False,
        soft_wrap=True,
    )


def build_fmu(file: Path, car: str = DEFAULT_CAR) -> Path:
    """Write the FMU; returns the path of its mapping file.

    Raises:
        MissingExtraError: pythonfmu is not installed.
        ConfigError: there is no such car, or the file cannot be written.
    """
    with needs_extra("fmu", "export-fmu"):
        from pythonfmu import FmuBuilder
    if file.suffix != ".fmu":
        raise ConfigError(f"{file}: expected a name that ends in .fmu. Choose one, as in car.fmu.")
    load_parameters(car)
    mapping = file.with_suffix(".toml")
    if car not in shipped_cars() and mapping.resolve() == Path(car).resolve():
        raise ConfigError(
            f"{file}: expected that its mapping can be written to {mapping}, found the car file "
            f"there. Choose another name for the FMU."
        )
    with tempfile.TemporaryDirectory(prefix="export-fmu-") as folder:
        script = Path(folder) / _SCRIPT
        source = resources.files("sim_bridge") / "adapters" / "fmu_slave.py"
        script.write_text(source.read_text(encoding="utf-8"), encoding="utf-8")
        inside = Path(folder) / "car.toml"
        inside.write_text(read_shipped_or_own(car, CARS_FOLDER, "car"), encoding="utf-8")
        built = Path(folder) / "built.fmu"
        FmuBuilder.build_FMU(script, dest=built, project_files=[inside], needsExecutionTool="true")
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
        *(f'{name} = "{name}"' for name in MOTION_FIELDS),
        *(f'{name} = "out_{name}"' for name in PlantOutputs._fields),
        "",
        "[start]",
        'vx_mps = "v0_mps"',
        'road_friction = "road_friction"',
    ]
    return "\n".join(lines) + "\n"
