"""Another tool's car as a plant: an FMU for co-simulation, FMI 2 or FMI 3."""

from collections.abc import Sequence
from math import isfinite, nan
from pathlib import Path

import numpy as np
from numpy import float64
from numpy.typing import NDArray

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from sim_bridge.adapters.fmu_instance import FmuInstance, RealBlock, open_fmu
from sim_bridge.adapters.fmu_links import (
    REAL_TYPES,
    Link,
    require_internal_step,
    resolve_inputs,
    resolve_outputs,
    resolve_start,
)
from sim_bridge.adapters.fmu_mapping import FmuMapping, load_mapping, mapping_beside
from sim_bridge.plant.protocol import PlantOutputs

START_TOLERANCE_MPS = 0.5
"""how far the FMU's first speed may be from the one asked for"""
_STEP_TOLERANCE_S = 1e-9
_MOTION = ("vx_mps", "vy_mps", "yaw_rate_radps")


class FmuPlant:
    """An FMU behind its mapping; see `Plant` for what its methods promise."""

    def __init__(self, path: Path, mapping: FmuMapping, road_friction: float) -> None:
        self.name = f"fmu:{path.name}"
        self.failure: str | None = None
        self._mapping = mapping
        self._road_friction = road_friction
        self._file = open_fmu(path)
        self._instance: FmuInstance | None = None
        try:
            self._inputs = resolve_inputs(self._file, mapping)
            self._outputs = resolve_outputs(self._file, mapping)
            self._start = resolve_start(self._file, mapping)
            self._parameters = [(self._file.variable(k), v) for k, v in mapping.parameters.items()]
            require_internal_step(self._file, mapping)
        except ConfigError:
            self._file.close()
            raise
        self._write: list[tuple[RealBlock, tuple[Link, ...]]] = []
        self._read: list[tuple[RealBlock, tuple[Link, ...]]] = []
        self._read_once: list[tuple[RealBlock, tuple[Link, ...]]] = []
        self._seen: dict[str, float] = {}
        self._steps = 0
        self._motion = np.empty((mapping.steps_per_period, 3))

    @property
    def takes_road_friction(self) -> bool:
        """Whether the mapping names a parameter for it."""
        return any(link.field == "road_friction" for link in self._start)

    def reset(self, v0_mps: float) -> NDArray[float64]:
        """(vx_mps, vy_mps, yaw_rate_radps) of a new instance.

        Raises:
            ConfigError: the FMU refuses its start values, or starts at another speed.
        """
        self._free()
        instance = self._instance = self._file.instantiate()
        self._steps = 0
        self.failure = None
        self._write = _blocks(instance, self._inputs)
        self._read = _blocks(instance, [link for link in self._outputs if link.field in _MOTION])
        self._read_once = _blocks(
            instance, [link for link in self._outputs if link.field not in _MOTION]
        )
        try:
            for variable, value in self._parameters:
                instance.set(variable, value)
            wanted = {"vx_mps": v0_mps, "road_friction": self._road_friction}
            for link in self._start:
                instance.set(link.variable, link.gain * wanted[link.field] + link.bias)
            instance.enter()
            self._send(NEUTRAL_INPUT)
            instance.start()
            self._look(self._read)
            self._look(self._read_once)
        except Exception as error:  # each tool's FMU fails in its own way
            raise ConfigError(
                f"{self.name}: expected an FMU that starts with the parameters of its mapping, "
                f"found {error} {instance.complaint()}. Correct [start] or [parameters]."
            ) from error
        first = np.array([self._seen[field] for field in _MOTION])
        if not np.isfinite(first).all():
            raise ConfigError(
                f"{self.name}: expected a car that starts with a motion, found "
                f"{dict(zip(_MOTION, first.tolist(), strict=True))}. Correct [start] or "
                f"[parameters] in the mapping file."
            )
        if not abs(first[0] - v0_mps) <= START_TOLERANCE_MPS:
            raise ConfigError(
                f"{self.name}: expected a car that starts at {v0_mps:.2f} m/s, found "
                f"{first[0]:.2f} m/s. Name the parameter for its first speed as start.vx_mps in "
                f"the mapping file, or choose a scenario with the FMU's own first speed."
            )
        return first

    def step(self, control: ControlInput, dt_s: float) -> NDArray[float64]:
        """(n, 3) motion after each communication step of the mapping."""
        step_s = self._mapping.communication_step_s
        n_steps = max(round(dt_s / step_s), 1)
        if n_steps != self._motion.shape[0]:
            self._motion = np.empty((n_steps, 3))
        if abs(n_steps * step_s - dt_s) > _STEP_TOLERANCE_S:
            self._fail(f"{dt_s} s are no whole number of its steps of {step_s} s")
        if self.failure is None:
            try:
                self._drive(control, n_steps, step_s)
            except Exception as error:  # each tool's FMU fails in its own way
                complaint = "" if self._instance is None else self._instance.complaint()
                self._fail(f"{error} {complaint}".rstrip())
        if self.failure is not None:
            self._motion[:] = nan
        return self._motion

    def outputs(self) -> PlantOutputs:
        """What the last step ended with; NaN where the mapping names no variable."""
        if self.failure is not None:
            return PlantOutputs()
        known = {k: v for k, v in self._seen.items() if k in PlantOutputs._fields}
        return PlantOutputs(**known)

    def close(self) -> None:
        """Free the instance, unload its library, remove what was unpacked."""
        self._free()
        self._file.close()

    def _drive(self, control: ControlInput, n_steps: int, step_s: float) -> None:
        instance = self._instance
        if instance is None:
            self._fail("it was closed")
            return
        self._send(control)
        for i in range(n_steps):
            if not instance.step(self._steps * step_s, step_s):
                self._fail("it ended the simulation")
                return
            self._steps += 1
            self._look(self._read)
            for column, field in enumerate(_MOTION):
                value = self._seen[field]
                self._motion[i, column] = value
                if not isfinite(value):
                    self._fail(f"{field} is {value}")
                    return
        self._look(self._read_once)

    def _fail(self, why: str) -> None:
        time_s = self._steps * self._mapping.communication_step_s
        self.failure = f"{self.name}: at {time_s:.3f} s: {why}"

    def _send(self, control: ControlInput) -> None:
        asked = control._asdict()
        for block, links in self._write:
            for i, link in enumerate(links):
                block.values[i] = link.gain * asked[link.field] + link.bias
            block.write()

    def _look(self, blocks: list[tuple[RealBlock, tuple[Link, ...]]]) -> None:
        for block, links in blocks:
            block.read()
            for i, link in enumerate(links):
                self._seen[link.field] = link.gain * block.values[i] + link.bias

    def _free(self) -> None:
        if self._instance is not None:
            self._instance.close()
            self._instance = None


def open_fmu_plant(path: Path, mapping: Path | None, road_friction: float) -> FmuPlant:
    """The plant in an FMU, with the mapping named or the one beside it.

    Raises:
        MissingExtraError: fmpy is not installed.
        ConfigError: FMU or mapping are missing or do not fit each other.
    """
    if not path.is_file():
        open_fmu(path)  # says so
    return FmuPlant(path, load_mapping(mapping or mapping_beside(path)), road_friction)


def _blocks(
    instance: FmuInstance, links: Sequence[Link]
) -> list[tuple[RealBlock, tuple[Link, ...]]]:
    blocks = []
    for kind in REAL_TYPES:
        alike = tuple(link for link in links if link.variable.type == kind)
        if alike:
            blocks.append((instance.reals([link.variable for link in alike]), alike))
    return blocks
