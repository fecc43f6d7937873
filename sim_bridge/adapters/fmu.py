"""`FmuPlant`: an FMU for co-simulation (FMI 2 or FMI 3) as a plant, run by fmpy.

If a whole number of communication steps is a period, both meet at the end of every period, and the
motion is what the FMU computed. Otherwise the FMU runs on its own grid: it computes the step that
contains the end of the period, with the input that was valid at the step's start, and the motion in
between is interpolated linearly. No value of the future is used: an FMU holds its inputs over a
step, so the end of the step follows from what is known at its start.
"""

import tempfile
from collections import deque
from collections.abc import Iterable, Mapping
from contextlib import suppress
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError, RtControllerError, needs_extra
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from sim_bridge.adapters.fmu_mapping import Link, load_mapping, resolve_links
from sim_bridge.plant.library import STEP_S
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs, RoadAt

START_TOLERANCE_MPS = 0.5
"""largest difference between the initial speed of the FMU and the wanted one"""
_TOLERANCE = 1e-3
"""of the communication step; rounding errors of times are far smaller"""
_WARNING = 1
_Groups = dict[str, list[Link]]
"""links by the type of their variables: those of one type are read or written in one call"""


def _unpacked(path: Path) -> tuple[Any, tempfile.TemporaryDirectory[str]]:
    """The model description of an FMU, and the folder with its files."""
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
            f"{path}: expected an FMU (a ZIP archive with modelDescription.xml), found "
            f"{error}. Export it again."
        ) from error
    wrong = ""
    if description.fmiMajorVersion not in (2, 3) or description.coSimulation is None:
        only = "" if description.coSimulation else ", model exchange only"
        wrong = (
            f"an FMU of FMI 2 or 3 for co-simulation, found FMI {description.fmiVersion}{only}. "
            f"Export it again as co-simulation, with its solver inside"
        )
    elif fmpy.platform not in platforms:
        wrong = (
            f"a library for {fmpy.platform}, found {', '.join(platforms) or 'none'}. Export it "
            f"again for this platform, or compile it here: fmpy compile {path.name}"
        )
    if wrong:
        folder.cleanup()
        raise ConfigError(f"{path}: expected {wrong}.")
    return description, folder


class FmuPlant:
    """An FMU with the given mapping file or the one beside it; see `Plant` for the methods.

    Raises:
        MissingExtraError: fmpy is not installed.
        ConfigError: FMU or mapping are missing or do not fit each other, or it is no FMU for
            co-simulation by FMI 2 or 3 on this machine.
    """

    def __init__(
        self,
        path: Path,
        mapping: Path | None,
        road_friction: float,
        friction_right: float | None = None,
    ) -> None:
        self.name = f"fmu:{path.name}"
        self.failure: str | None = None
        self._description, self._folder = _unpacked(path)
        try:
            described = load_mapping(mapping or path.with_suffix(".toml"))
            links = resolve_links(self._description, path.name, described)
        except RtControllerError:
            self._folder.cleanup()
            raise
        right = road_friction if friction_right is None else friction_right
        self._frictions = {"road_friction": road_friction, "road_friction_right": right}
        self._is_fmi2 = self._description.fmiMajorVersion == 2
        self._fmu: Any = None
        self._is_started = False
        self._messages = deque[str](maxlen=3)
        self._start, self._parameters = links.start, links.parameters
        self._inputs, self._road_links = _grouped(links.inputs), _grouped(links.road)
        self._moving = _grouped(link for link in links.outputs if link.field in MOTION_FIELDS)
        self._others = _grouped(link for link in links.outputs if link.field not in MOTION_FIELDS)
        self.start_fields = frozenset(link.field for link in links.start)
        """start values for which the mapping names a parameter"""
        self.road_inputs = frozenset(link.field for link in links.road)
        """fields of `RoadAt` that act on this FMU"""
        self._road: RoadAt | None = None  # ground of the coming period, until it is written
        self._values: dict[str, float] = {}
        self._step_s = described.communication_step_s
        self._steps, self._period_start_s = 0, 0.0
        # Of the last period; what the FMU's inputs are.
        self._input = self._written = NEUTRAL_INPUT
        self._points: list[tuple[float, ...]] = []
        """time and motion of the last two communication points, and of those of this period"""

    def reset(self, v0_mps: float) -> Array:
        """(vx_mps, vy_mps, yaw_rate_radps) of a new instance.

        Raises:
            ConfigError: the FMU refuses its start values, or starts at another speed.
        """
        self._free()
        self._steps, self._period_start_s = 0, 0.0
        self._input = NEUTRAL_INPUT
        self._road = self.failure = None
        try:
            self._instantiate(v0_mps)
        except Exception as error:  # the FMUs of each tool fail differently
            raise ConfigError(
                f"{self.name}: expected an FMU that starts with the parameters of its mapping, "
                f"found {self._explain(error)}. Correct [start] or [parameters], or see the FMU's "
                f"documentation."
            ) from error
        start = np.array([self._values[field] for field in MOTION_FIELDS])
        if not (np.isfinite(start).all() and abs(start[0] - v0_mps) <= START_TOLERANCE_MPS):
            found = ", ".join(f"{k} {v:.2f}" for k, v in zip(MOTION_FIELDS, start, strict=True))
            raise ConfigError(
                f"{self.name}: expected a car that starts with vx_mps {v0_mps:.2f}, found {found}. "
                f"Name the parameter for its initial speed as start.vx_mps in the mapping file, "
                f"correct [parameters], or choose a scenario with the FMU's own speed."
            )
        self._points = [(0.0, *start)]
        return start

    def set_road(self, road: RoadAt) -> None:
        """Drive on this ground from the next communication point on."""
        self._road = road if self.road_inputs else None

    def step(self, control: ControlInput, dt_s: float) -> Array:
        """(n, 3) motion: after each communication step, or every millisecond; see the module."""
        n_points = round(dt_s / self._step_s)
        if n_points < 1 or abs(n_points * self._step_s - dt_s) > _TOLERANCE * self._step_s:
            n_points = max(1, round(dt_s / STEP_S))
        if self._fmu is None:
            self._fail("it was closed")
        elif self.failure is None:
            try:
                self._advance(control, self._period_start_s + dt_s)
            except Exception as error:  # the FMUs of each tool fail differently
                self._fail(self._explain(error))
        if self.failure is not None:
            return np.full((n_points, len(MOTION_FIELDS)), nan)
        times_s = self._period_start_s + np.arange(1, n_points + 1) * (dt_s / n_points)
        self._period_start_s += dt_s
        point_s, *motion = np.array(self._points).T
        self._points = self._points[-2:]
        return np.column_stack([np.interp(times_s, point_s, values) for values in motion])

    def outputs(self) -> PlantOutputs:
        """Values at the end of the last step; NaN where the mapping names no variable."""
        if self.failure is not None:
            return PlantOutputs()
        return PlantOutputs(**{k: v for k, v in self._values.items() if k in PlantOutputs._fields})

    def close(self) -> None:
        """Free the instance, unload its library, remove the unpacked files."""
        self._free()
        self._folder.cleanup()

    def _instantiate(self, v0_mps: float) -> None:
        from fmpy.simulation import instantiate_fmu

        given = (self._folder.name, self._description, "CoSimulation")
        fmu = self._fmu = instantiate_fmu(*given, debug_logging=True, logger=self._log)
        wanted = {"vx_mps": v0_mps, **self._frictions}
        starts = [(k.variable, k.gain * wanted[k.field] + k.bias) for k in self._start]
        for variable, value in (*self._parameters, *starts):
            kind = variable.type
            if kind == "Enumeration":
                kind = "Integer" if self._is_fmi2 else "Int64"
            getattr(fmu, f"set{kind}")([variable.valueReference], [value])
        if self._is_fmi2:
            fmu.setupExperiment(startTime=0.0)
        fmu.enterInitializationMode()
        self._written = NEUTRAL_INPUT
        self._write(self._inputs, NEUTRAL_INPUT._asdict())
        fmu.exitInitializationMode()
        self._is_started = True
        self._read(self._moving)
        self._read(self._others)

    def _advance(self, control: ControlInput, end_s: float) -> None:
        """Step the FMU up to the end of the period, or beyond it."""
        step_s, slack_s = self._step_s, _TOLERANCE * self._step_s
        while (fmu_s := self._steps * step_s) < end_s - slack_s:
            if self._road is not None:
                self._write(self._road_links, self._road._asdict())
                self._road = None
            # A step that begins before this period begins with the input of the last one.
            valid = self._input if fmu_s < self._period_start_s - slack_s else control
            if valid != self._written:
                self._written = valid
                self._write(self._inputs, valid._asdict())
            # FMI 3 answers with (event needed, is over, is early, time), FMI 2 with nothing.
            answer = self._fmu.doStep(fmu_s, step_s)
            if not self._is_fmi2 and (answer[1] or answer[2]):
                self._fail("it ended the simulation")
                return
            self._steps += 1
            self._read(self._moving)
            motion = [self._values[field] for field in MOTION_FIELDS]
            self._points.append((self._steps * step_s, *motion))
            for field, value in zip(MOTION_FIELDS, motion, strict=True):
                if not isfinite(value):
                    self._fail(f"{field} is {value}")
                    return
        self._input = control
        self._read(self._others)

    def _write(self, groups: _Groups, wanted: Mapping[str, float]) -> None:
        for kind, links in groups.items():
            values = [link.gain * wanted[link.field] + link.bias for link in links]
            references = [link.variable.valueReference for link in links]
            getattr(self._fmu, f"set{kind}")(references, values)

    def _read(self, groups: _Groups) -> None:
        for kind, links in groups.items():
            references = [link.variable.valueReference for link in links]
            values = getattr(self._fmu, f"get{kind}")(references)
            for link, value in zip(links, values, strict=True):
                self._values[link.field] = link.gain * value + link.bias

    def _fail(self, reason: str) -> None:
        self.failure = f"{self.name}: at {self._steps * self._step_s:.3f} s: {reason}"

    def _explain(self, error: Exception) -> str:
        """The error with the last warnings and errors of the FMU."""
        return f"{error} ({'; '.join(self._messages)})" if self._messages else str(error)

    def _log(self, *arguments: Any) -> None:
        """Callback of FMI 2 and FMI 3: both end with (status, category, message)."""
        status, _, message = arguments[-3:]
        if status >= _WARNING and message:
            self._messages.append(message.decode("utf-8", "replace").strip())

    def _free(self) -> None:
        if self._fmu is not None:
            with suppress(Exception):
                if self._is_started:
                    self._fmu.terminate()
            self._fmu.freeInstance()
            self._fmu, self._is_started = None, False
            self._messages.clear()


def _grouped(links: Iterable[Link]) -> _Groups:
    groups: _Groups = {}
    for link in links:
        groups.setdefault(link.variable.type, []).append(link)
    return groups
