"""`python -m benchmarks.rivals.bicycle_fit`: fit the bicycle to 54 s of driving."""

from typing import Any

import numpy as np
from scipy.optimize import least_squares

from benchmarks.rivals.scenarios import FIT
from rt_controller import simulate
from rt_controller.baselines.bicycle import FILE, IMAGINARY, Parameters, advance
from rt_controller.contract.arrays import Array
from rt_controller.contract.figures import write_figures
from rt_controller.contract.signals import ControlInput, StateColumn, VehicleState

COMMAND, DRIVER = "python -m benchmarks.rivals.bicycle_fit", "mdk-net"
DELAY = 2
"""periods after which a command acts"""
_STEPS, _STRIDE = 20, 5
"""periods of a prediction in the fit, and from the begin of one to the next"""
_ERRORS = np.array(VehicleState(0.1, 0.05, 0.01, 1.0, 0.02, 0.005))
"""errors that count the same in the fit; progress has no weight, since it follows from the speed"""
_OBSERVED = [c for c in StateColumn if c is not StateColumn.ds_m]


def fit() -> dict[str, Any]:
    """Parameters of the least squares of all predictions of 20 periods, and their errors."""
    starts, inputs, curvatures, targets = [], [], [], []
    for scenario in FIT:
        drive = simulate(scenario, model=DRIVER)
        columns = list(drive.columns)
        states = drive.values[:, [columns.index(name) for name in VehicleState._fields]]
        sent = drive.values[:, [columns.index(name) for name in ControlInput._fields]]
        curvature = drive["curvature_per_m"]
        last = int(np.flatnonzero([mode.drives for mode in drive.modes])[-1])
        for k in range(DELAY, last - _STEPS, _STRIDE):
            starts.append(states[k])
            inputs.append(sent[k - DELAY : k - DELAY + _STEPS])
            curvatures.append(curvature[k : k + _STEPS])
            targets.append(states[k + 1 : k + 1 + _STEPS])
    x, u, kappa = np.array(starts).T, np.transpose(inputs, (1, 2, 0)), np.transpose(curvatures)
    wanted = np.transpose(targets, (1, 2, 0))
    """of each step: states (20, 6, count)"""

    def errors(values: Array) -> Array:
        """Weighted errors (20, 5, count) with parameters (11,), or (11, 1, ...) of several cars."""
        now, found = tuple(x), []
        for step in range(_STEPS):
            now = advance(now, tuple(u[step]), kappa[step], Parameters(*values))
            found.append(np.stack(now, axis=-2))
        error = (np.stack(found, axis=-3) - wanted) / _ERRORS[:, None]
        return np.asarray(error[..., _OBSERVED, :] / np.sqrt(len(starts) * _STEPS))

    first = np.array(Parameters())

    def jacobian(scale: Array) -> Array:
        moved = np.diag(first) * 1j * IMAGINARY + scale * first
        columns = errors(moved.T[:, :, None]).imag / IMAGINARY
        return np.asarray(columns.reshape(len(first), -1).T)

    found = least_squares(
        lambda scale: errors(scale * first).ravel(),
        np.ones(len(first)),
        jacobian,
        loss="soft_l1",
        bounds=(0.02, 20.0),
    )
    squares = np.square(errors(found.x * first)).sum(axis=(0, 2))
    rms = np.sqrt(squares) * _ERRORS[_OBSERVED]
    return {
        "command": COMMAND,
        "scenarios": [scenario.name for scenario in FIT],
        "driver": DRIVER,
        "driven_s": sum(scenario.duration_s for scenario in FIT),
        "predictions": len(starts),
        "rms_over_half_a_second": {c.name: float(x) for c, x in zip(_OBSERVED, rms, strict=True)},
        "parameters": dict(zip(Parameters._fields, (found.x * first).tolist(), strict=True)),
    }


if __name__ == "__main__":
    write_figures(FILE, fit())
