"""The car as an FMU sees it: inputs, start, step, outputs, all as compiled functions.

The C of an FMU is generated from these functions and from what they call, so that the plant has one
implementation. The pose is that of `sim_bridge.frenet`: on a road without curvature (s_m, ey_m,
epsi_rad) are the position x, y and the heading.
"""

from typing import NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import ControlInput
from sim_bridge.frenet import EPSI, EY, S, advance_interval
from sim_bridge.plant.consistency import Contradictions, contradictions_of
from sim_bridge.plant.jit import compiled
from sim_bridge.plant.library import N_OUTPUTS, _settle, advance, write_outputs
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.protocol import MOTION_FIELDS, PlantOutputs
from sim_bridge.plant.states import AT, N_STATES

N_POSE = 3
POSE_FIELDS = ("s_m", "ey_m", "epsi_rad")
_N_MOTION = 3
_FIRST_FURTHER = _N_MOTION + N_POSE
_N_CONTRADICTIONS = len(Contradictions._fields)
N_EXPORTED = _FIRST_FURTHER + N_OUTPUTS
STATE_FIELDS = (*MOTION_FIELDS, *POSE_FIELDS)
"""outputs that are states, on which no input acts directly"""
OUTPUT_FIELDS = (*STATE_FIELDS, *(f"out_{name}" for name in PlantOutputs._fields))
"""names of the outputs; further ones have a prefix, since `throttle` is an input too"""


class ExportedInput(NamedTuple):
    """Inputs of the FMU."""

    throttle: float
    """accelerator pedal; limited to 0..1"""
    brake_n: float
    """force on the brake pedal; negative values count as 0"""
    steer_rad: float
    """angle of the steering wheel, positive to the left"""
    curvature_per_m: float
    """of the road, positive to the left; used for s, e_y and e_psi only"""


class ExportedStart(NamedTuple):
    """How the car starts: driving straight ahead, everything else settled."""

    v0_mps: float
    """initial speed"""
    ey0_m: float
    """initial distance to the left of the reference line"""
    epsi0_rad: float
    """initial heading relative to the reference line, positive to the left"""


@compiled
def contradiction(p: Parameters) -> int:
    """Position in `Contradictions` of a field that contradicts others; -1 if there is none."""
    found = contradictions_of(p.body, p.tyre, p.engine, p.gearbox, p.motor, p.tyre_file)
    for i in range(_N_CONTRADICTIONS):
        if found[i]:
            return i
    return -1


@compiled
def start(initial: ExportedStart, p: Parameters, state: Array, pose: Array) -> None:
    """Write the settled car to `state` (N_STATES,) and its place on the road to `pose` (3,)."""
    settled = _settle(initial.v0_mps, p)
    for i in range(N_STATES):
        state[i] = settled[i]
    pose[S] = 0.0
    pose[EY] = initial.ey0_m
    pose[EPSI] = initial.epsi0_rad


@compiled
def step(
    inputs: ExportedInput, p: Parameters, n_steps: int, step_s: float, state: Array, pose: Array
) -> None:
    """Advance `state` and `pose` by `n_steps` under constant inputs, in place."""
    control = _control(inputs)
    before = np.empty(_N_MOTION)
    motion = np.empty((1, _N_MOTION))
    for _ in range(n_steps):
        before[0] = state[AT.vx_mps]
        before[1] = state[AT.vy_mps]
        before[2] = state[AT.yaw_rate_radps]
        advance(state, control, p, len(motion), step_s, motion)
        advance_interval(before, motion[0], inputs.curvature_per_m, step_s, pose)


@compiled
def write_exported(
    inputs: ExportedInput, p: Parameters, state: Array, pose: Array, outputs: Array
) -> None:
    """Fill `outputs` (N_EXPORTED,); their names are `OUTPUT_FIELDS`."""
    outputs[0] = state[AT.vx_mps]
    outputs[1] = state[AT.vy_mps]
    outputs[2] = state[AT.yaw_rate_radps]
    for i in range(N_POSE):
        outputs[_N_MOTION + i] = pose[i]
    write_outputs(state, _control(inputs), p, outputs[_FIRST_FURTHER:])


@compiled
def _control(inputs: ExportedInput) -> ControlInput:
    """The inputs of the plant, with the pedals inside their range."""
    throttle = min(1.0, max(0.0, inputs.throttle))
    return ControlInput(throttle, max(0.0, inputs.brake_n), inputs.steer_rad)
