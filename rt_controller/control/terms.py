"""Terms of eq. (14): weights from the deviations that an engineer tolerates, and constraints."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import N_INPUTS, ControlInput, StateColumn, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.knots import Knots

Heading = Literal["course", "epsi"]


@dataclass(frozen=True, slots=True)
class InputConstraints:
    """lower <= v <= upper and -slew <= D v <= slew, for the nv = 3 K inputs v at the knots.

    v are the inputs in units of their ranges. At the first knot the change is counted from the
    previous input, so the bounds of those rows move every period.
    """

    D: Array
    """(nv, nv), row (j, i): v_j,i - v_(j-1),i"""
    slew: Array
    """(nv,), the largest change from one knot to the next"""
    scale: Array
    """(nv,), the range of each input: u = scale * v"""
    lower: Array
    """(nv,)"""
    upper: Array
    """(nv,)"""


def constrain_inputs(knots: Knots) -> InputConstraints:
    """Bounds of the inputs and of their changes at the knots.

    Paper: eq. (14), with slew rates added.
    """
    lower, upper = np.array(INPUT_LIMITS.lower), np.array(INPUT_LIMITS.upper)
    range_ = upper - lower
    count = knots.count
    nv = count * N_INPUTS
    slew = np.tile(np.array(INPUT_LIMITS.rate_per_s) * PERIOD_S / range_, (count, 1))
    slew[1:] *= knots.intervals[:-1, None]
    return InputConstraints(
        D=np.eye(nv) - np.eye(nv, k=-N_INPUTS),
        slew=slew.reshape(-1),
        scale=np.tile(range_, count),
        lower=np.tile(lower / range_, count),
        upper=np.tile(upper / range_, count),
    )


class Corridor(NamedTuple):
    """Soft bounds on the distance from the path."""

    half_width_m: float
    beyond_m: float
    """excess that costs as much as a tolerated deviation of a state"""

    @property
    def weight(self) -> float:
        return 1.0 / self.beyond_m**2


class TrackingCost(NamedTuple):
    """Deviations that each cost one unit (Bryson's rule): a weight is 1 / tolerance^2.

    An infinite tolerance is a weight of zero.
    """

    state: VehicleState
    """tolerated deviation from the reference at one stage"""
    control: ControlInput
    """tolerated size of an input: R of eq. (14)"""
    control_change: ControlInput
    """tolerated change of an input from one period to the next"""
    terminal_factor: float = 1.0
    """Q_N = terminal_factor * Q"""
    heading: Heading = "course"
    """which angle follows the direction of the path, with the tolerance of epsi_rad"""


class CostTerms(NamedTuple):
    """Cost of eq. (14) with p outputs y a stage, and inputs v in units of their ranges.

    1/2 (y - y_r)' Q (y - y_r) + 1/2 v' H v + (from_previous * u_prev)' v_0, with nv = 3 K inputs.
    """

    columns: tuple[StateColumn, ...]
    """states that are outputs: those with a weight, and e_y"""
    has_course: bool
    """the course is the last output"""
    weights: Array
    """(K, p), the diagonal of Q at the end of each interval between knots"""
    H: Array
    """(nv, nv), of the inputs and of their changes"""
    from_previous: Array
    """(3,)"""
    scale: Array
    """(nv,), the range of each input: u = scale * v"""
    knots: Knots


def cost_terms(cost: TrackingCost, constraints: InputConstraints, knots: Knots) -> CostTerms:
    """The terms for these tolerances; a state counts for all periods of its interval.

    Paper: eq. (14), with the cost of changes added.
    """
    with np.errstate(over="ignore"):  # no weight, as an infinite tolerance
        stage = 1.0 / np.square(np.array(cost.state, dtype=float))
    has_course = cost.heading == "course" and stage[StateColumn.epsi_rad] > 0.0
    columns = [c for c in StateColumn if stage[c] > 0.0 or c is StateColumn.ey_m]
    if has_course:  # the last one
        columns.remove(StateColumn.epsi_rad)
    of_outputs = stage[[*columns, StateColumn.epsi_rad][: len(columns) + has_course]]
    scale = constraints.scale
    weights = knots.intervals[:, None] * of_outputs
    weights[-1] *= cost.terminal_factor
    interpolation, horizon = knots.interpolation, knots.horizon
    to_stages = np.kron(interpolation, np.eye(N_INPUTS)) * scale
    """(3 N, nv), v -> the inputs of all stages"""
    change = to_stages - np.vstack([np.zeros((N_INPUTS, scale.size)), to_stages[:-N_INPUTS]])
    r = np.tile(1.0 / np.square(np.array(cost.control, dtype=float)), horizon)
    s = np.tile(1.0 / np.square(np.array(cost.control_change, dtype=float)), horizon)
    # u_prev enters the change of the first stage only: -s (u_0 - u_prev).
    from_previous = -s[:N_INPUTS] * scale[:N_INPUTS]
    H = (to_stages.T * r) @ to_stages + (change.T * s) @ change
    return CostTerms(tuple(columns), has_course, weights, H, from_previous, scale, knots)
