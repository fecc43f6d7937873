"""`FmuFile` and `FmuInstance`: FMUs of FMI 2 and FMI 3 behind one interface; the user of fmpy."""

import tempfile
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from rt_controller.contract.errors import ConfigError, needs_extra

Value = bool | int | float | str
_WARNING = 1
_FMI2 = 2
_MAX_MESSAGES = 3


class FmuFile:
    """An FMU on disk, checked and unpacked into a temporary folder.

    Raises:
        MissingExtraError: fmpy is not installed.
        ConfigError: there is no FMU, or none for co-simulation by FMI 2 or 3 on this machine.
    """

    def __init__(self, path: Path) -> None:
        with needs_extra("fmu", "`plant` fmu"):
            import fmpy
        if not path.is_file():
            raise ConfigError(
                f"{path}: expected an FMU, found no such file. Name the .fmu file after fmu:."
            )
        try:
            description = fmpy.read_model_description(str(path), validate=False)
            platforms = fmpy.supported_platforms(str(path))
        except Exception as error:  # zip, XML and version errors have many types
            raise ConfigError(
                f"{path}: expected an FMU (a ZIP archive with modelDescription.xml), found "
                f"{error}. Export it again."
            ) from error
        if description.fmiMajorVersion not in (2, 3):
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
                f"{', '.join(platforms) or 'none'}. Export it again for this platform, or "
                f"compile it here: fmpy compile {path.name}"
            )
        self.path = path
        self.description = description
        # Also removed when the process ends without `close`.
        self.folder = tempfile.TemporaryDirectory(prefix="fmu-", ignore_cleanup_errors=True)
        try:
            fmpy.extract(str(path), unzipdir=self.folder.name)
        except Exception as error:  # zip errors and refused paths
            self.close()
            raise ConfigError(
                f"{path}: expected an archive that can be unpacked, found {error}. Export the FMU "
                f"again."
            ) from error

    def variable(self, name: str) -> Any:
        """The description of a variable.

        Raises:
            ConfigError: the FMU has no variable of this name.
        """
        names = [variable.name for variable in self.description.modelVariables]
        if name in names:
            return self.description.modelVariables[names.index(name)]
        near = get_close_matches(name, names, n=5, cutoff=0.4) or names[:8]
        raise ConfigError(
            f"{self.path.name}: expected a variable {name!r}, found none of that name "
            f"({', '.join(near)}, …). Correct the mapping file."
        )

    def close(self) -> None:
        """Remove the temporary folder."""
        self.folder.cleanup()


class FmuInstance:
    """One instance, from initialisation to termination; a failed FMI call raises.

    Raises:
        ConfigError: the FMU's library cannot be loaded or cannot be instantiated.
    """

    def __init__(self, file: FmuFile) -> None:
        from fmpy.simulation import instantiate_fmu

        self._messages: list[str] = []
        self._is_fmi2 = file.description.fmiMajorVersion == _FMI2
        self._is_started = False
        try:
            self._fmu = instantiate_fmu(
                file.folder.name,
                file.description,
                "CoSimulation",
                debug_logging=True,
                logger=self._log,
            )
        except Exception as error:  # fmpy raises plain exceptions here
            raise ConfigError(
                f"{file.path.name}: expected an FMU that can be instantiated, found {error} "
                f"{self.messages()}. Its documentation states what it needs."
            ) from error

    def enter_initialization(self) -> None:
        """Begin the initialisation; parameters and inputs may be set until `start`."""
        if self._is_fmi2:
            self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()

    def start(self) -> None:
        """End the initialisation."""
        self._fmu.exitInitializationMode()
        self._is_started = True

    def set(self, variable: Any, value: Value) -> None:
        """Set one variable of any type."""
        kind = variable.type
        if kind == "Enumeration":
            kind = "Integer" if self._is_fmi2 else "Int64"
        self.write(kind, [variable.valueReference], [value])

    def write(self, kind: str, references: Sequence[int], values: Sequence[Value]) -> None:
        """Set variables of one type, by their value references."""
        getattr(self._fmu, f"set{kind}")(references, values)

    def read(self, kind: str, references: Sequence[int]) -> list[float]:
        """The values of real variables of one type: Real, Float64 or Float32."""
        values: list[float] = getattr(self._fmu, f"get{kind}")(references)
        return values

    def step(self, time_s: float, step_s: float) -> bool:
        """Compute one communication step; False if the FMU ends the simulation or returns early."""
        if self._is_fmi2:
            self._fmu.doStep(time_s, step_s)
            return True
        _, is_over, is_early, _ = self._fmu.doStep(time_s, step_s)
        return not (is_over or is_early)

    def messages(self) -> str:
        """The last warnings and errors of the FMU in brackets; empty if there are none."""
        return f"({'; '.join(self._messages)})" if self._messages else ""

    def close(self) -> None:
        """Terminate and free the instance; errors of the termination are ignored."""
        try:
            if self._is_started:
                self._fmu.terminate()
        except Exception:
            pass
        finally:
            self._fmu.freeInstance()

    def _log(self, *arguments: Any) -> None:
        """Callback of FMI 2 and FMI 3: both end with (status, category, message)."""
        status, _, message = arguments[-3:]
        if status >= _WARNING and message:
            self._messages.append(message.decode("utf-8", "replace").strip())
            del self._messages[:-_MAX_MESSAGES]
