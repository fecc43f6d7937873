"""The signals of a model: which states, inputs and exogenous signals, in which order and unit.

A data set and the model learned from it may have any signals; the controller drives only with
`VEHICLE`.
Paper: eq. (2), "set of states and inputs".
"""

from dataclasses import dataclass
from typing import NamedTuple

from rt_controller.contract.signals import (
    EXOGENOUS_FIELDS,
    EXOGENOUS_UNITS,
    INPUT_UNITS,
    STATE_UNITS,
    ControlInput,
    VehicleState,
)
from rt_controller.contract.timing import PERIOD_S


class Signal(NamedTuple):
    """One column of numbers."""

    name: str
    """ends in the unit where there is one"""
    unit: str


@dataclass(frozen=True, slots=True)
class Schema:
    """Names, order, units and period of the signals of a model."""

    states: tuple[Signal, ...]
    inputs: tuple[Signal, ...]
    exogenous: tuple[Signal, ...]
    """known ahead but not chosen by the controller"""
    dt_s: float

    @property
    def state_names(self) -> tuple[str, ...]:
        return tuple(signal.name for signal in self.states)

    @property
    def input_names(self) -> tuple[str, ...]:
        return tuple(signal.name for signal in self.inputs)

    @property
    def exogenous_names(self) -> tuple[str, ...]:
        return tuple(signal.name for signal in self.exogenous)


VEHICLE = Schema(
    states=tuple(map(Signal, VehicleState._fields, STATE_UNITS)),
    inputs=tuple(map(Signal, ControlInput._fields, INPUT_UNITS)),
    exogenous=tuple(map(Signal, EXOGENOUS_FIELDS, EXOGENOUS_UNITS)),
    dt_s=PERIOD_S,
)
"""of the car in the Frenet frame of its road"""
N_STATES = len(VEHICLE.states)
N_INPUTS = len(VEHICLE.inputs)
N_EXOGENOUS = len(VEHICLE.exogenous)
