"""One of CasADi's methods, called through its buffers, without a copy that is not needed."""

from math import nan
from typing import Any

import numpy as np

from benchmarks.peers.nonlinear.methods import Method
from benchmarks.peers.nonlinear.program import Moment
from rt_controller.contract.bundle import Array
from rt_controller.contract.limits import InputLimits
from rt_controller.control.cost import TrackingCost

TRUSTED_GAP = 1e-2
"""between the stages of a plan that is used, in the units of the states"""


class Shooting:
    """`Planning` from the last plan and multipliers on."""

    def __init__(
        self, method: Method, horizon: int, cost: TrackingCost, limits: InputLimits
    ) -> None:
        program = method.pose(horizon, cost, limits)
        solver = method.open(program)
        size, rows = program.z.size, program.row_lower.size
        self._program = program
        self._bound_multipliers, self._row_multipliers = np.zeros(size), np.zeros(rows)
        self._found = {
            "x": np.full(size, nan),
            "g": np.full(rows, nan),
            "lam_x": np.zeros(size),
            "lam_g": np.zeros(rows),
        }
        given = {
            "x0": program.z,
            "p": program.parameters,
            "lbx": program.lower,
            "ubx": program.upper,
            "lbg": program.row_lower,
            "ubg": program.row_upper,
            "lam_x0": self._bound_multipliers,
            "lam_g0": self._row_multipliers,
        }
        buffer: Any
        buffer, self._run = solver.buffer()
        self._buffer = buffer  # which owns what `_run` reads and writes
        for at, name in enumerate(solver.name_in()):
            buffer.set_arg(at, given[name].data)
        for at, name in enumerate(solver.name_out()):
            if name in self._found:
                buffer.set_res(at, self._found[name].data)

    def solve(self, moment: Moment, inputs: Array) -> bool:
        """As `Planning.solve`."""
        program, found = self._program, self._found
        program.aim(moment)
        self._run()
        program.z[:] = found["x"]
        self._bound_multipliers[:] = found["lam_x"]
        self._row_multipliers[:] = found["lam_g"]
        program.read(inputs)
        rows = found["g"]
        gap = np.maximum(rows - program.row_upper, program.row_lower - rows).max()
        return bool(np.isfinite(inputs).all() and gap < TRUSTED_GAP)
