"""Inputs that change in every period: drive, brake, and steering to both sides."""

import numpy as np

from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S


def wandering_inputs(n_periods: int) -> list[ControlInput]:
    t = np.arange(n_periods) * PERIOD_S
    return [
        ControlInput(max(0.0, np.sin(x)), 60.0 * max(0.0, -np.sin(x)), float(s))
        for x, s in zip(t, 0.6 * np.sin(1.7 * t), strict=True)
    ]
