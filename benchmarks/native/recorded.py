"""Calls of a planner in a drive, recorded, and repeated on another planner."""

import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from rt_controller.config import ControllerConfig
from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import AT_REST, ControlInput
from rt_controller.control.planner import Planner
from rt_controller.control.program import SolveStatus
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_planner
from rt_controller.simulation import car_settings_of, drive_in_lockstep
from sim_bridge.scenario import Scenario

_OBSERVATIONS = ("observe", "observe_estimate", "assume_steady")
_OTHERS = ("plan", "prepare", "forget", "reset", "resume", "limit_steering")
_SPAN = np.array(ControlInput(1.0, 150.0, 2.0 * np.radians(40.0)))
"""range of each input"""


class Call(NamedTuple):
    """A method of a planner or of its observer, and its arguments."""

    name: str
    arguments: tuple[Any, ...] = ()


class Recorder:
    """A planner that notes the calls that change it."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self.calls: list[Call] = []
        self.observer = _Recorded(planner.observer, _OBSERVATIONS, self.calls)

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._planner, name)
        return _noting(found, name, self.calls) if name in _OTHERS else found


class _Recorded:
    def __init__(self, target: object, names: Sequence[str], calls: list[Call]) -> None:
        self._target, self._names, self._calls = target, names, calls

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._target, name)
        return _noting(found, name, self._calls) if name in self._names else found


def _noting(method: Any, name: str, calls: list[Call]) -> Any:
    def call(*arguments: Any) -> Any:
        calls.append(Call(name, arguments))
        return method(*arguments)

    return call


def record_drive(
    bundle: Bundle, scenario: Scenario, plant: str = "own", duration_s: float | None = None
) -> list[Call]:
    """The calls of the MPC in a drive of the simulated car."""
    config = ControllerConfig()
    recorder: Any = Recorder(build_planner(bundle, config))
    car = car_settings_of(plant=plant)
    drive_in_lockstep(config, bundle, recorder, car, None, duration_s, scenario)
    calls: list[Call] = recorder.calls
    return calls


class Planned(NamedTuple):
    """What a planner made of a call of `plan`."""

    status: SolveStatus
    inputs: Array
    """(N, 3), the last plan that was solved"""
    iterations: int
    plan_ns: int
    prepare_ns: int = 0
    """0: no `prepare` followed"""


def repeat(calls: Iterable[Call], planner: Planner) -> Iterator[Planned]:
    """The plans of the same calls; each plan begins at the state that this planner has filtered."""
    found, x_0 = None, AT_REST
    for name, arguments in calls:
        if name in _OBSERVATIONS:
            answer = getattr(planner.observer, name)(*arguments)
            x_0 = x_0 if answer is None else answer
        elif name == "plan":
            if found is not None:
                yield found
            begun_ns = time.perf_counter_ns()
            status = planner.plan(x_0, *arguments[1:])
            elapsed_ns = time.perf_counter_ns() - begun_ns
            found = Planned(status, planner.inputs.copy(), planner.iterations, elapsed_ns)
        else:
            begun_ns = time.perf_counter_ns()
            getattr(planner, name)(*arguments)
            if name == "prepare" and found is not None:
                found = found._replace(prepare_ns=time.perf_counter_ns() - begun_ns)
    if found is not None:
        yield found


def difference(one: Planned, other: Planned) -> float:
    """The largest of all stages, in units of each input's range; NaN unless both are solved."""
    if not one.status is other.status is SolveStatus.SOLVED:
        return float("nan")
    return float(np.max(np.abs(one.inputs - other.inputs) / _SPAN))
