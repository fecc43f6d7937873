"""`FmuPlant`: an FMU for co-simulation (FMI 2 or FMI 3) as a plant."""

from collections.abc import Iterable
from math import isfinite, nan
from pathlib import Path

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError, RtControllerError
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from sim_bridge.adapters.fmu_file import FmuFile, FmuInstance
from sim_bridge.adapters.fmu_links import Link, require_internal_step, resolve_links
from sim_bridge.adapters.fmu_mapping import FmuMapping, load_mapping
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs

START_TOLERANCE_MPS = 0.5
"""largest difference between the initial speed of the FMU and the wanted one"""
_STEP_TOLERANCE_S = 1e-9


_Groups = dict[str, list[Link]]
"""links by the type of their variables: those of one type are read or written in one call"""


class FmuPlant:
    """An FMU with its mapping; see `Plant` for the methods."""

    def __init__(self, file: FmuFile, mapping: FmuMapping, road_friction: float) -> None:
        self.name = f"fmu:{file.path.name}"
        self.failure: str | None = None
        self._mapping = mapping
        self._road_friction = road_friction
        self._file = file
        self._instance: FmuInstance | None = None
        inputs, outputs, self._start = resolve_links(self._file, mapping)
        self._inputs = _grouped(inputs)
        self._motion_groups = _grouped(link for link in outputs if link.field in MOTION_FIELDS)
        self._other_groups = _grouped(link for link in outputs if link.field not in MOTION_FIELDS)
        self._parameters = [(self._file.variable(k), v) for k, v in mapping.parameters.items()]
        require_internal_step(self._file, mapping)
        self._values: dict[str, float] = {}
        self._steps = 0
        self._motion = np.empty((0, len(MOTION_FIELDS)))

    @property
    def takes_road_friction(self) -> bool:
        """True if the mapping names a parameter for it."""
        return any(link.field == "road_friction" for link in self._start)

    def reset(self, v0_mps: float) -> Array:
        """(vx_mps, vy_mps, yaw_rate_radps) of a new instance.

        Raises:
            ConfigError: the FMU refuses its start values, or starts at another speed.
        """
        self._free()
        instance = self._instance = FmuInstance(self._file)
        self._steps = 0
        self.failure = None
        try:
            for variable, value in self._parameters:
                instance.set(variable, value)
            wanted = {"vx_mps": v0_mps, "road_friction": self._road_friction}
            for link in self._start:
                instance.set(link.variable, link.gain * wanted[link.field] + link.bias)
            instance.enter_initialization()
            self._write_inputs(instance, NEUTRAL_INPUT)
            instance.start()
            self._read(instance, self._motion_groups)
            self._read(instance, self._other_groups)
        except Exception as error:  # the FMUs of each tool fail differently
            raise ConfigError(
                f"{self.name}: expected an FMU that starts with the parameters of its mapping, "
                f"found {error} {instance.messages()}. Correct [start] or [parameters]."
            ) from error
        first = {field: self._values[field] for field in MOTION_FIELDS}
        if not all(map(isfinite, first.values())):
            raise ConfigError(
                f"{self.name}: expected a car that starts with a motion, found {first}. Correct "
                f"[start] or [parameters] in the mapping file."
            )
        if not abs(first["vx_mps"] - v0_mps) <= START_TOLERANCE_MPS:
            raise ConfigError(
                f"{self.name}: expected a car that starts at {v0_mps:.2f} m/s, found "
                f"{first['vx_mps']:.2f} m/s. Name the parameter for its initial speed as "
                f"start.vx_mps in the mapping file, or choose a scenario with the FMU's own speed."
            )
        return np.array(list(first.values()))

    def step(self, control: ControlInput, dt_s: float) -> Array:
        """(n, 3) motion after each communication step of the mapping."""
        step_s = self._mapping.communication_step_s
        n_steps = max(round(dt_s / step_s), 1)
        if n_steps != self._motion.shape[0]:
            self._motion = np.empty((n_steps, len(MOTION_FIELDS)))
        if abs(n_steps * step_s - dt_s) > _STEP_TOLERANCE_S:
            self._fail(f"{dt_s} s are no whole number of its steps of {step_s} s")
        elif self._instance is None:
            self._fail("it was closed")
        elif self.failure is None:
            try:
                self._advance(self._instance, control, n_steps, step_s)
            except Exception as error:  # the FMUs of each tool fail differently
                self._fail(f"{error} {self._instance.messages()}".rstrip())
        if self.failure is not None:
            self._motion[:] = nan
        return self._motion

    def outputs(self) -> PlantOutputs:
        """Values at the end of the last step; NaN where the mapping names no variable."""
        if self.failure is not None:
            return PlantOutputs()
        known = {k: v for k, v in self._values.items() if k in PlantOutputs._fields}
        return PlantOutputs(**known)

    def close(self) -> None:
        """Free the instance, unload its library, remove the unpacked files."""
        self._free()
        self._file.close()

    def _advance(
        self, instance: FmuInstance, control: ControlInput, n_steps: int, step_s: float
    ) -> None:
        self._write_inputs(instance, control)
        for i in range(n_steps):
            if not instance.step(self._steps * step_s, step_s):
                self._fail("it ended the simulation")
                return
            self._steps += 1
            self._read(instance, self._motion_groups)
            for column, field in enumerate(MOTION_FIELDS):
                value = self._values[field]
                self._motion[i, column] = value
                if not isfinite(value):
                    self._fail(f"{field} is {value}")
                    return
        self._read(instance, self._other_groups)

    def _fail(self, reason: str) -> None:
        time_s = self._steps * self._mapping.communication_step_s
        self.failure = f"{self.name}: at {time_s:.3f} s: {reason}"

    def _write_inputs(self, instance: FmuInstance, control: ControlInput) -> None:
        inputs = control._asdict()
        for kind, links in self._inputs.items():
            values = [link.gain * inputs[link.field] + link.bias for link in links]
            instance.write(kind, [link.variable.valueReference for link in links], values)

    def _read(self, instance: FmuInstance, groups: _Groups) -> None:
        for kind, links in groups.items():
            values = instance.read(kind, [link.variable.valueReference for link in links])
            for link, value in zip(links, values, strict=True):
                self._values[link.field] = link.gain * value + link.bias

    def _free(self) -> None:
        if self._instance is not None:
            self._instance.close()
            self._instance = None


def open_fmu_plant(path: Path, mapping: Path | None, road_friction: float) -> FmuPlant:
    """The plant in an FMU, with the given mapping file or the one beside the FMU.

    Raises:
        MissingExtraError: fmpy is not installed.
        ConfigError: FMU or mapping are missing or do not fit each other.
    """
    file = FmuFile(path)
    try:
        return FmuPlant(file, load_mapping(mapping or path.with_suffix(".toml")), road_friction)
    except RtControllerError:
        file.close()
        raise


def _grouped(links: Iterable[Link]) -> _Groups:
    groups: _Groups = {}
    for link in links:
        groups.setdefault(link.variable.type, []).append(link)
    return groups
