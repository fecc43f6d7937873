"""An exported FMU as a Python object: variables by name."""

import tempfile
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import fmpy
from fmpy.simulation import instantiate_fmu
from made_tyre import TYRE_FILE_TEXT

from sim_bridge.fmu_export.archive import build_fmu

CAR = "c_class_150kw_awd"
_FOLDER = tempfile.TemporaryDirectory(prefix="exported-fmus-")


@cache
def exported(car: str = CAR) -> Path:
    """The FMU of a car, made once."""
    file = Path(_FOLDER.name) / f"{Path(car).stem}-car.fmu"
    build_fmu(file, car)
    return file


@cache
def car_with_tyre_file() -> str:
    """Path of the default car's file, which names a made tyre file."""
    text = (resources.files("sim_bridge") / "cars" / f"{CAR}.toml").read_text("utf-8")
    entry = 'tyre_file = { value = "made.tir", source = "estimate: a made file" }\n'
    folder = Path(_FOLDER.name)
    (folder / "made.tir").write_text(TYRE_FILE_TEXT, encoding="utf-8")
    (folder / "with_tyre_file.toml").write_text(entry + text, encoding="utf-8")
    return str(folder / "with_tyre_file.toml")


class ExportedFmu:
    """One instance; a failed call raises, with what the FMU logged in `messages`."""

    def __init__(self, file: Path) -> None:
        self.description = fmpy.read_model_description(str(file))
        self._folder = tempfile.TemporaryDirectory(prefix="exported-fmu-")
        fmpy.extract(str(file), unzipdir=self._folder.name)
        self.messages: list[str] = []
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.instance: Any = instantiate_fmu(
            self._folder.name, self.description, "CoSimulation", logger=self._log
        )
        self.step, self.close = self.instance.doStep, self.instance.freeInstance

    def set(self, **values: float) -> None:
        """Set variables; `road__bank_rad` is road.bank_rad."""
        names = [name.replace("__", ".") for name in values]
        self.instance.setReal([self.references[name] for name in names], list(values.values()))

    def get(self, *names: str) -> list[float]:
        """Values of variables."""
        return list(self.instance.getReal([self.references[name] for name in names]))

    def initialise(self, start_s: float = 0.0) -> None:
        """From instantiation to the first step."""
        self.instance.setupExperiment(startTime=start_s)
        self.instance.enterInitializationMode()
        self.instance.exitInitializationMode()

    def _log(self, *arguments: Any) -> None:
        message = arguments[-1]
        self.messages.append(message.decode() if isinstance(message, bytes) else str(message))
