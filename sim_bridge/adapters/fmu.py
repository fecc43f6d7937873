"""`FmuPlant`: an FMU for co-simulation (FMI 2 or FMI 3) as a plant."""

from collections.abc import Iterable
from math import isfinite, nan
from pathlib import Path

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError, RtControllerError
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from sim_bridge.adapters.fmu_clock import FmuClock
from sim_bridge.adapters.fmu_file import FmuFile, FmuInstance
from sim_bridge.adapters.fmu_links import Link, resolve_links
from sim_bridge.adapters.fmu_mapping import FmuMapping, load_mapping
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs, RoadAt

START_TOLERANCE_MPS = 0.5
"""largest difference between the initial speed of the FMU and the wanted one"""


_Groups = dict[str, list[Link]]
"""links by the type of their variables: those of one type are read or written in one call"""


class FmuPlant:
    """An FMU with its mapping; see `Plant` for the methods."""

    def __init__(
        self,
        file: FmuFile,
        mapping: FmuMapping,
        road_friction: float,
        friction_right: float | None = None,
    ) -> None:
        self.name = f"fmu:{file.path.name}"
        self.failure: str | None = None
        self._mapping = mapping
        self._frictions = {
            "road_friction": road_friction,
            "road_friction_right": road_friction if friction_right is None else friction_right,
        }
        self._file = file
        self._instance: FmuInstance | None = None
        links = resolve_links(self._file, mapping)
        self._inputs, self._start = _grouped(links.inputs), links.start
        self._motion_groups = _grouped(k for k in links.outputs if k.field in MOTION_FIELDS)
        self._other_groups = _grouped(k for k in links.outputs if k.field not in MOTION_FIELDS)
        self._parameters = links.parameters
        self._road_groups = _grouped(links.road)
        self.road_inputs = frozenset(link.field for link in links.road)
        """fields of `RoadAt` that act on this FMU"""
        self._road: RoadAt | None = None
        """ground of the coming period, until it is written"""
        self._values: dict[str, float] = {}
        self._clock = FmuClock(mapping.communication_step_s)
        self._input = NEUTRAL_INPUT
        """of the last period"""
        self._written = NEUTRAL_INPUT
        """what the FMU's inputs are"""
        self._last = np.zeros((2, len(MOTION_FIELDS)))
        """motion at the last two communication points"""
        self._motion = np.empty((0, len(MOTION_FIELDS)))

    def takes(self, field: str) -> bool:
        """True if the mapping names a parameter for this start value."""
        return any(link.field == field for link in self._start)

    def reset(self, v0_mps: float) -> Array:
        """(vx_mps, vy_mps, yaw_rate_radps) of a new instance.

        Raises:
            ConfigError: the FMU refuses its start values, or starts at another speed.
        """
        self._free()
        instance = self._instance = FmuInstance(self._file)
        self._clock.restart()
        self._input = NEUTRAL_INPUT
        self._road = None
        self.failure = None
        try:
            for variable, value in self._parameters:
                instance.set(variable, value)
            wanted = {"vx_mps": v0_mps, **self._frictions}
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
        start = np.array(list(first.values()))
        self._last[:] = start
        return start

    def set_road(self, road: RoadAt) -> None:
        """Drive on this ground from the next communication point on."""
        self._road = road if self.road_inputs else None

    def step(self, control: ControlInput, dt_s: float) -> Array:
        """(n, 3) motion: after each communication step, or every millisecond, see `FmuClock`."""
        n_points = self._clock.points_in(dt_s)
        if n_points != self._motion.shape[0]:
            self._motion = np.empty((n_points, len(MOTION_FIELDS)))
        if self._instance is None:
            self._fail("it was closed")
        elif self.failure is None:
            try:
                self._advance(self._instance, control, n_points, dt_s)
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
        self, instance: FmuInstance, control: ControlInput, n_points: int, dt_s: float
    ) -> None:
        clock = self._clock
        for i in range(n_points):
            time_s = clock.period_start_s + (i + 1) * dt_s / n_points
            while clock.is_before(time_s):
                self._write_road(instance)
                valid = self._input if clock.is_in_past else control
                if valid != self._written:
                    self._write_inputs(instance, valid)
                if not instance.step(clock.fmu_s, clock.step_s):
                    self._fail("it ended the simulation")
                    return
                clock.count_step()
                self._read_motion(instance)
                if self.failure is not None:
                    return
            share = clock.share_of_step(time_s)
            self._motion[i] = self._last[1] - (1.0 - share) * (self._last[1] - self._last[0])
        clock.end_period(dt_s)
        self._input = control
        self._read(instance, self._other_groups)

    def _read_motion(self, instance: FmuInstance) -> None:
        self._read(instance, self._motion_groups)
        self._last[0] = self._last[1]
        for column, field in enumerate(MOTION_FIELDS):
            value = self._values[field]
            self._last[1, column] = value
            if not isfinite(value):
                self._fail(f"{field} is {value}")

    def _fail(self, reason: str) -> None:
        self.failure = f"{self.name}: at {self._clock.fmu_s:.3f} s: {reason}"

    def _write_inputs(self, instance: FmuInstance, control: ControlInput) -> None:
        self._written = control
        inputs = control._asdict()
        for kind, links in self._inputs.items():
            values = [link.gain * inputs[link.field] + link.bias for link in links]
            instance.write(kind, [link.variable.valueReference for link in links], values)

    def _write_road(self, instance: FmuInstance) -> None:
        if self._road is None:
            return
        road = self._road._asdict()
        for kind, links in self._road_groups.items():
            values = [link.gain * road[link.field] + link.bias for link in links]
            instance.write(kind, [link.variable.valueReference for link in links], values)
        self._road = None

    def _read(self, instance: FmuInstance, groups: _Groups) -> None:
        for kind, links in groups.items():
            values = instance.read(kind, [link.variable.valueReference for link in links])
            for link, value in zip(links, values, strict=True):
                self._values[link.field] = link.gain * value + link.bias

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
    file = FmuFile(path)
    try:
        return FmuPlant(
            file,
            load_mapping(mapping or path.with_suffix(".toml")),
            road_friction,
            friction_right,
        )
    except RtControllerError:
        file.close()
        raise


def _grouped(links: Iterable[Link]) -> _Groups:
    groups: _Groups = {}
    for link in links:
        groups.setdefault(link.variable.type, []).append(link)
    return groups
