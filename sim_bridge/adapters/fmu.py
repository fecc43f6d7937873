"""`FmuPlant`: an FMU for co-simulation (FMI 2 or FMI 3) as a plant; the user of fmpy.

If a whole number of communication steps is a period, both meet at the end of every period, and the
motion is what the FMU computed. Otherwise the FMU runs on its own grid: it computes the step that
contains the end of the period, with the input that was valid at the step's start, and the motion in
between is interpolated linearly. No value of the future is used: an FMU holds its inputs over a
step, so the end of the step follows from what is known at its start.
"""

import tempfile
from collections.abc import Iterable, Mapping
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError, RtControllerError, needs_extra
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from sim_bridge.adapters.fmu_mapping import Link, Links, load_mapping, resolve
from sim_bridge.plant.library import STEP_S
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs, RoadAt

_START_MPS = 0.5
"""largest difference between the initial speed of the FMU and the wanted one"""
_TIME_TOLERANCE = 1e-3
"""of the communication step; rounding errors of times are far smaller"""
_WARNING = 1
_MAX_MESSAGES = 3

_Folder = tempfile.TemporaryDirectory[str]
_Groups = dict[str, list[Link]]
"""links by the type of their variables: those of one type are read or written in one call"""


class _Instance:
    """One instance of FMI 2 or 3, from initialisation to termination; a failed FMI call raises.

    Raises:
        ConfigError: the FMU's library cannot be loaded or cannot be instantiated.
    """

    def __init__(self, name: str, folder: str, description: Any) -> None:
        from fmpy.simulation import instantiate_fmu

        self._messages: list[str] = []
        self._is_fmi2 = description.fmiMajorVersion == 2
        self._is_started = False
        try:
            self._fmu = instantiate_fmu(
                folder, description, "CoSimulation", debug_logging=True, logger=self._log
            )
        except Exception as error:  # fmpy raises plain exceptions here
            raise ConfigError(
                f"{name}: expected an FMU that can be instantiated, found {error} "
                f"{self.messages()}. Its documentation states what it needs."
            ) from error

    def initialise(self, groups: _Groups, inputs: Mapping[str, float]) -> None:
        if self._is_fmi2:
            self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()
        self.write(groups, inputs)
        self._fmu.exitInitializationMode()
        self._is_started = True

    def set(self, variable: Any, value: Any) -> None:
        """Set one variable of any type."""
        kind = variable.type
        if kind == "Enumeration":
            kind = "Integer" if self._is_fmi2 else "Int64"
        getattr(self._fmu, f"set{kind}")([variable.valueReference], [value])

    def write(self, groups: _Groups, values: Mapping[str, float]) -> None:
        for kind, links in groups.items():
            converted = [link.gain * values[link.field] + link.bias for link in links]
            put = getattr(self._fmu, f"set{kind}")
            put([link.variable.valueReference for link in links], converted)

    def read(self, groups: _Groups) -> dict[str, float]:
        """By field: the values of the contract."""
        values = {}
        for kind, links in groups.items():
            get = getattr(self._fmu, f"get{kind}")
            found = get([link.variable.valueReference for link in links])
            for link, value in zip(links, found, strict=True):
                values[link.field] = link.gain * value + link.bias
        return values

    def step(self, time_s: float, step_s: float) -> bool:
        """Compute one communication step; False if the FMU ends the simulation or returns early."""
        told = self._fmu.doStep(time_s, step_s)
        if self._is_fmi2:
            return True
        _, is_over, is_early, _ = told
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


class FmuPlant:
    """An unpacked FMU with its mapping; see `Plant` for the methods."""

    def __init__(
        self,
        file: str,
        description: Any,
        folder: _Folder,
        links: Links,
        communication_step_s: float,
        frictions: dict[str, float],
    ) -> None:
        self.name = f"fmu:{file}"
        self.failure: str | None = None
        self.road_inputs = frozenset(link.field for link in links.road)
        """fields of `RoadAt` that act on this FMU"""
        self._description = description
        self._folder = folder
        self._instance: _Instance | None = None
        self._links = links
        self._inputs, self._road_links = _grouped(links.inputs), _grouped(links.road)
        self._motion_links = _grouped(k for k in links.outputs if k.field in MOTION_FIELDS)
        self._other_links = _grouped(k for k in links.outputs if k.field not in MOTION_FIELDS)
        self._frictions = frictions
        self._step_s = communication_step_s
        self._n_steps = 0
        """communication steps since the start of the run"""
        self._period_start_s = 0.0
        self._road: RoadAt | None = None
        """ground of the coming period, until it is written"""
        self._input = self._written = NEUTRAL_INPUT
        """of the last period; what the FMU's inputs are"""
        self._last = np.zeros((2, len(MOTION_FIELDS)))
        """motion at the last two communication points"""
        self._outputs = PlantOutputs()

    def takes(self, field: str) -> bool:
        """True if the mapping names a parameter for this start value."""
        return any(link.field == field for link in self._links.start)

    def reset(self, v0_mps: float) -> Array:
        """(vx_mps, vy_mps, yaw_rate_radps) of a new instance.

        Raises:
            ConfigError: the FMU refuses its start values, or starts at another speed.
        """
        self._free()
        self._n_steps, self._period_start_s = 0, 0.0
        self._input = self._written = NEUTRAL_INPUT
        self._road = self.failure = None
        instance = self._instance = _Instance(self.name, self._folder.name, self._description)
        start = {"vx_mps": v0_mps, **self._frictions}
        try:
            for variable, value in self._links.parameters:
                instance.set(variable, value)
            instance.write(_grouped(self._links.start), start)
            instance.initialise(self._inputs, NEUTRAL_INPUT._asdict())
            first = instance.read(self._motion_links)
            self._outputs = PlantOutputs(**instance.read(self._other_links))
        except Exception as error:  # the FMUs of each tool fail differently
            raise ConfigError(
                f"{self.name}: expected an FMU that starts with the parameters of its mapping, "
                f"found {error} {instance.messages()}. Correct [start] or [parameters]."
            ) from error
        start_motion = np.array([first[field] for field in MOTION_FIELDS])
        if not (np.isfinite(start_motion).all() and abs(start_motion[0] - v0_mps) <= _START_MPS):
            raise ConfigError(
                f"{self.name}: expected a car that starts at {v0_mps:.2f} m/s, found "
                f"{', '.join(f'{field} {value:.2f}' for field, value in first.items())}. Name the "
                f"parameter for its initial speed as start.vx_mps in the mapping file, or choose a "
                f"scenario with the FMU's own speed."
            )
        self._last[:] = start_motion
        return start_motion

    def set_road(self, road: RoadAt) -> None:
        """Drive on this ground from the next communication point on."""
        self._road = road if self.road_inputs else None

    def step(self, control: ControlInput, dt_s: float) -> Array:
        """(n, 3) motion: after each communication step, or every millisecond on another grid."""
        n_points = round(dt_s / self._step_s)
        if abs(n_points * self._step_s - dt_s) > _TIME_TOLERANCE * self._step_s:
            n_points = max(1, round(dt_s / STEP_S))
        motion = np.full((n_points, len(MOTION_FIELDS)), nan)
        if self._instance is None:
            self._fail("it was closed")
        elif self.failure is None:
            try:
                self._advance(self._instance, control, dt_s, motion)
            except Exception as error:  # the FMUs of each tool fail differently
                self._fail(f"{error} {self._instance.messages()}".rstrip())
        if self.failure is not None:
            motion[:] = nan
            self._outputs = PlantOutputs()
        return motion

    def outputs(self) -> PlantOutputs:
        """Values at the end of the last step; NaN where the mapping names no variable."""
        return self._outputs

    def close(self) -> None:
        """Free the instance, unload its library, remove the unpacked files."""
        self._free()
        self._folder.cleanup()

    def _advance(
        self, instance: _Instance, control: ControlInput, dt_s: float, motion: Array
    ) -> None:
        tolerance_s = _TIME_TOLERANCE * self._step_s
        for i in range(len(motion)):
            time_s = self._period_start_s + (i + 1) * dt_s / len(motion)
            while self._fmu_s < time_s - tolerance_s:
                began_before = self._fmu_s < self._period_start_s - tolerance_s
                self._compute_step(instance, self._input if began_before else control)
                if self.failure is not None:
                    return
            behind_s = self._fmu_s - time_s
            share = behind_s / self._step_s if behind_s > tolerance_s else 0.0
            motion[i] = self._last[1] - share * (self._last[1] - self._last[0])
        self._period_start_s += dt_s
        self._input = control
        self._outputs = PlantOutputs(**instance.read(self._other_links))

    def _compute_step(self, instance: _Instance, control: ControlInput) -> None:
        if self._road is not None:
            instance.write(self._road_links, self._road._asdict())
            self._road = None
        if control != self._written:
            instance.write(self._inputs, control._asdict())
            self._written = control
        if not instance.step(self._fmu_s, self._step_s):
            self._fail("it ended the simulation")
            return
        self._n_steps += 1
        values = instance.read(self._motion_links)
        self._last[0] = self._last[1]
        self._last[1] = [values[field] for field in MOTION_FIELDS]
        for field, value in values.items():
            if not isfinite(value):
                self._fail(f"{field} is {value}")

    @property
    def _fmu_s(self) -> float:
        """Time of the last communication point."""
        return self._n_steps * self._step_s

    def _fail(self, reason: str) -> None:
        self.failure = f"{self.name}: at {self._fmu_s:.3f} s: {reason}"

    def _free(self) -> None:
        if self._instance is not None:
            self._instance.close()
            self._instance = None


def open_fmu_plant(
    path: Path, mapping: Path | None, road_friction: float, friction_right: float | None = None
) -> FmuPlant:
    """The plant in an FMU, with the given mapping file or the one beside the FMU.

    Raises:
        MissingExtraError: fmpy is not installed.
        ConfigError: FMU or mapping are missing or do not fit each other.
    """
    right = road_friction if friction_right is None else friction_right
    frictions = {"road_friction": road_friction, "road_friction_right": right}
    description, folder = _unpacked(path)
    try:
        found = load_mapping(mapping or path.with_suffix(".toml"))
        links = resolve(found, description, path.name)
    except RtControllerError:
        folder.cleanup()
        raise
    return FmuPlant(path.name, description, folder, links, found.communication_step_s, frictions)


def _unpacked(path: Path) -> tuple[Any, _Folder]:
    """Model description and files of an FMU for co-simulation on this machine."""
    with needs_extra("fmu", "`plant` fmu"):
        import fmpy
    if not path.is_file():
        raise ConfigError(
            f"{path}: expected an FMU, found no such file. Name the .fmu file after fmu:."
        )
    # Also removed when the process ends without `close`.
    folder = tempfile.TemporaryDirectory(prefix="fmu-", ignore_cleanup_errors=True)
    try:
        description = fmpy.read_model_description(str(path), validate=False)
        platforms = fmpy.supported_platforms(str(path))
        fmpy.extract(str(path), unzipdir=folder.name)
    except Exception as error:  # zip, XML and version errors have many types
        folder.cleanup()
        raise ConfigError(
            f"{path}: expected an FMU (a ZIP archive with modelDescription.xml), found {error}. "
            f"Export it again."
        ) from error
    is_known = description.fmiMajorVersion in (2, 3) and description.coSimulation is not None
    if not is_known or fmpy.platform not in platforms:
        folder.cleanup()
        kind = "model exchange only" if description.coSimulation is None else "co-simulation"
        raise ConfigError(
            f"{path}: expected FMI 2 or FMI 3 for co-simulation with a library for "
            f"{fmpy.platform}, found FMI {description.fmiVersion} for {kind} with libraries for "
            f"{', '.join(platforms) or 'no platform'}. Export it again; a library that is missing "
            f"only may be compiled here: fmpy compile {path.name}"
        )
    return description, folder


def _grouped(links: Iterable[Link]) -> _Groups:
    groups: _Groups = {}
    for link in links:
        groups.setdefault(link.variable.type, []).append(link)
    return groups
