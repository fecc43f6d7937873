"""Calls of a planner in a drive, recorded, and repeated on another planner."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import AT_REST, ControlInput
from rt_controller.control.planner import Planner
from rt_controller.control.program import SolveStatus

_OBSERVATIONS = ("observe", "observe_estimate", "assume_steady")
_OTHERS = ("plan", "prepare", "forget", "reset", "resume", "limit_steering")


class Call(NamedTuple):
    """A method of a planner or of its observer, and its arguments."""

    name: str
    arguments: tuple[Any, ...]


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


class Planned(NamedTuple):
    """What a planner made of a call of `plan`."""

    status: SolveStatus
    inputs: Array
    """(N, 3), the last plan that was solved"""
    iterations: int


def repeat(calls: Sequence[Call], planner: Planner) -> list[Planned]:
    """The plans of the same calls; each plan begins at the state that this planner has filtered."""
    found, x_0 = [], AT_REST
    for name, arguments in calls:
        if name in _OBSERVATIONS:
            answer = getattr(planner.observer, name)(*arguments)
            x_0 = x_0 if answer is None else answer
        elif name == "plan":
            status = planner.plan(x_0, *arguments[1:])
            found.append(Planned(status, planner.inputs.copy(), planner.iterations))
        else:
            getattr(planner, name)(*arguments)
    return found


def largest_difference(one: Sequence[Planned], other: Sequence[Planned]) -> Array:
    """Of each plan that both solved, over all stages, in units of the range of each input."""
    span = np.array(ControlInput(1.0, 150.0, 2.0 * np.radians(40.0)))
    both = [
        (a, b)
        for a, b in zip(one, other, strict=True)
        if a.status is b.status is SolveStatus.SOLVED
    ]
    return np.array([np.max(np.abs(a.inputs - b.inputs) / span) for a, b in both])
