"""One running FMU: FMI 2 and FMI 3 behind the same few calls. Only this room knows fmpy."""

import tempfile
from collections.abc import Sequence
from ctypes import byref
from pathlib import Path
from typing import Any

from rt_controller.contract.errors import ConfigError, MissingExtraError

Value = bool | int | float | str
_WARNING = 1
_FMI2 = 2
_MAX_MESSAGES = 3


def open_fmu(path: Path) -> "FmuFile":
    """An FMU, checked and unpacked.

    Raises:
        MissingExtraError: fmpy is not installed.
        ConfigError: there is no FMU, or none for co-simulation by FMI 2 or 3 on this machine.
    """
    try:
        import fmpy
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"--plant fmu needs {error.name}: expected the extra [fmu], found it missing. Install "
            f'it with: pip install -e ".[fmu]"'
        ) from error
    if not path.is_file():
        raise ConfigError(
            f"{path}: expected an FMU, found no such file. Name the .fmu file after fmu:."
        )
    try:
        description = fmpy.read_model_description(str(path), validate=False)
        platforms = fmpy.supported_platforms(str(path))
    except Exception as error:  # zip, XML and version errors come in many kinds
        raise ConfigError(
            f"{path}: expected an FMU (a ZIP archive with modelDescription.xml), found {error}. "
            f"Export it again."
        ) from error
    version = description.fmiMajorVersion
    if version not in (2, 3):
        raise ConfigError(
            f"{path}: expected FMI 2 or FMI 3, found FMI {description.fmiVersion}. Export it "
            f"again with another version."
        )
    if description.coSimulation is None:
        raise ConfigError(
            f"{path}: expected an FMU for co-simulation, found model exchange only. Export it "
            f"again as co-simulation, with its solver inside."
        )
    if fmpy.platform not in platforms:
        raise ConfigError(
            f"{path}: expected a library for {fmpy.platform}, found "
            f"{', '.join(platforms) or 'none'}. Export it again for this platform, or compile it "
            f"here: fmpy compile {path.name}"
        )
    return FmuFile(path, description)


class FmuFile:
    """An FMU on disk, unpacked into a folder of its own."""

    def __init__(self, path: Path, description: Any) -> None:
        import fmpy

        self.path = path
        self.description = description
        # Also removed when the process ends without `close`.
        self._folder = tempfile.TemporaryDirectory(prefix="fmu-", ignore_cleanup_errors=True)
        try:
            fmpy.extract(str(path), unzipdir=self._folder.name)
        except Exception as error:  # zip errors and refused paths
            self.close()
            raise ConfigError(
                f"{path}: expected an archive that can be unpacked, found {error}. Export the FMU "
                f"again."
            ) from error

    def variable(self, name: str) -> Any:
        """The description of a variable.

        Raises:
            ConfigError: the FMU has none of that name.
        """
        for variable in self.description.modelVariables:
            if variable.name == name:
                return variable
        raise ConfigError(
            f"{self.path.name}: expected a variable {name!r}, found {self._names_near(name)}. "
            f"Correct the mapping file."
        )

    def instantiate(self) -> "FmuInstance":
        """A new instance, not initialised yet.

        Raises:
            ConfigError: the FMU's library cannot be loaded or refuses.
        """
        return FmuInstance(self.path.name, self.description, self._folder.name)

    def close(self) -> None:
        """Remove the unpacked folder."""
        self._folder.cleanup()

    def _names_near(self, name: str) -> str:
        from difflib import get_close_matches

        names = [variable.name for variable in self.description.modelVariables]
        near = get_close_matches(name, names, n=5, cutoff=0.4) or names[:8]
        return "none of that name (" + ", ".join(near) + ", …)"


class FmuInstance:
    """One instance, from its initialisation to its end; what the FMU refuses raises."""

    def __init__(self, file_name: str, description: Any, folder: str) -> None:
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        self.messages: list[str] = []
        """the last complaints of the FMU itself"""
        self._is_fmi2 = description.fmiMajorVersion == _FMI2
        self._was_entered = False
        try:
            self._fmu = (FMU2Slave if self._is_fmi2 else FMU3Slave)(
                guid=description.guid,
                unzipDirectory=folder,
                modelIdentifier=description.coSimulation.modelIdentifier,
                instanceName="car",
            )
            self._instantiate()
        except Exception as error:  # fmpy raises plain exceptions here
            raise ConfigError(
                f"{file_name}: expected an FMU that can be instantiated, found {error} "
                f"{self.complaint()}. Its documentation says what it needs beside it."
            ) from error

    def enter(self) -> None:
        """Begin the initialisation; parameters and inputs may be set from here to `start`."""
        if self._is_fmi2:
            self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()

    def start(self) -> None:
        """End the initialisation."""
        self._fmu.exitInitializationMode()
        self._was_entered = True

    def set(self, variable: Any, value: Value) -> None:
        """Set one variable of any type; for what is not in the loop."""
        kind = {"Enumeration": "Integer" if self._is_fmi2 else "Int64"}.get(
            variable.type, variable.type
        )
        getattr(self._fmu, f"set{kind}")([variable.valueReference], [value])

    def reals(self, variables: Sequence[Any]) -> "RealBlock":
        """A block of variables that is read or written in one go.

        All of them count in the same type: Real, Float64 or Float32.
        """
        return RealBlock(self._fmu, self._is_fmi2, variables)

    def step(self, time_s: float, step_s: float) -> bool:
        """Compute one communication step; False where the FMU ends there or stops short."""
        if self._is_fmi2:
            self._fmu.doStep(time_s, step_s)
            return True
        _, is_over, is_short, _ = self._fmu.doStep(time_s, step_s)
        return not (is_over or is_short)

    def complaint(self) -> str:
        """What the FMU said last, in brackets; empty where it said nothing."""
        return f"({'; '.join(self.messages)})" if self.messages else ""

    def close(self) -> None:
        """End and free the instance; what it says to that comes too late to matter."""
        try:
            if self._was_entered:
                self._fmu.terminate()
        except Exception:
            pass
        finally:
            self._fmu.freeInstance()

    def _instantiate(self) -> None:
        if not self._is_fmi2:
            self._fmu.instantiate(loggingOn=True, logMessage=self._hear)
            return
        from fmpy import calloc, free
        from fmpy.fmi1 import addLoggerProxy
        from fmpy.fmi2 import (
            fmi2CallbackAllocateMemoryTYPE,
            fmi2CallbackFreeMemoryTYPE,
            fmi2CallbackFunctions,
            fmi2CallbackLoggerTYPE,
        )

        callbacks = fmi2CallbackFunctions()
        callbacks.logger = fmi2CallbackLoggerTYPE(
            lambda _, __, status, category, message: self._hear(None, status, category, message)
        )
        callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
        callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
        addLoggerProxy(byref(callbacks))
        self._fmu.instantiate(callbacks=callbacks, loggingOn=True)

    def _hear(self, _: Any, status: int, __: Any, message: bytes | None) -> None:
        if status >= _WARNING and message:
            self.messages.append(message.decode("utf-8", "replace").strip())
            del self.messages[:-_MAX_MESSAGES]


class RealBlock:
    """Some real variables of an instance, with the memory for their values."""

    def __init__(self, fmu: Any, is_fmi2: bool, variables: Sequence[Any]) -> None:
        from fmpy.fmi2 import fmi2Real, fmi2ValueReference
        from fmpy.fmi3 import fmi3Float32, fmi3Float64, fmi3ValueReference

        self._fmu = fmu
        self._n = len(variables)
        self._takes_size = not is_fmi2
        references = [variable.valueReference for variable in variables]
        kind = variables[0].type if variables else "Float64"
        if is_fmi2:
            self._references = (fmi2ValueReference * self._n)(*references)
            self.values = (fmi2Real * self._n)()
            self._read, self._write = fmu.fmi2GetReal, fmu.fmi2SetReal
        else:
            self._references = (fmi3ValueReference * self._n)(*references)
            self.values = ((fmi3Float32 if kind == "Float32" else fmi3Float64) * self._n)()
            self._read = getattr(fmu, f"fmi3Get{kind}")
            self._write = getattr(fmu, f"fmi3Set{kind}")

    def read(self) -> None:
        """Fill `values` from the FMU."""
        self._call(self._read)

    def write(self) -> None:
        """Hand `values` to the FMU."""
        self._call(self._write)

    def _call(self, function: Any) -> None:
        if self._n == 0:
            return
        if self._takes_size:
            function(self._fmu.component, self._references, self._n, self.values, self._n)
        else:
            function(self._fmu.component, self._references, self._n, self.values)
