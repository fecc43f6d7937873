"""What may be asked of a driver's hands and feet over the horizon, in units of their ranges."""

from dataclasses import dataclass

import numpy as np

from rt_controller.contract.bundle import Array
from rt_controller.contract.limits import InputLimits
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S

N_INPUTS = len(ControlInput._fields)


@dataclass(frozen=True, slots=True)
class InputConstraints:
    """lower <= v <= upper and -slew <= D v <= slew, for the nv = 3 N inputs v of a horizon.

    At the first stage the change is counted from the previous input, so a tick moves those bounds.
    """

    D: Array
    """(nv, nv), row (k, i): v_k,i - v_(k-1),i"""
    slew: Array
    """(nv,), the largest change in one period"""
    scale: Array
    """(nv,), the range of each input: u = scale * v"""
    lower: Array
    """(nv,)"""
    upper: Array
    """(nv,)"""


def constrain_inputs(horizon: int, limits: InputLimits) -> InputConstraints:
    """The constraints of eq. (14), with slew rates added. Paper: eq. (14)."""
    lower, upper = np.array(limits.lower), np.array(limits.upper)
    range_ = upper - lower
    nv = horizon * N_INPUTS
    return InputConstraints(
        D=np.eye(nv) - np.eye(nv, k=-N_INPUTS),
        slew=np.tile(np.array(limits.rate_per_s) * PERIOD_S / range_, horizon),
        scale=np.tile(range_, horizon),
        lower=np.tile(lower / range_, horizon),
        upper=np.tile(upper / range_, horizon),
    )
