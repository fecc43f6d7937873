"""What the right answers are, whoever gives them: certified by their optimality conditions."""

import daqp
import numpy as np

from benchmarks.peers.recording import Matrices, Recording
from rt_controller.contract.bundle import Array
from rt_controller.control.constraints import N_INPUTS
from rt_controller.control.program import QuadraticProgram

CERTAIN = 1e-7


class UncertainError(Exception):
    """No answer could be certified."""


def exact_first_inputs(recording: Recording) -> Array:
    """(ticks, 3), of every problem that is no rehearsal.

    Raises:
        UncertainError: an answer does not meet the optimality conditions to 1e-7.
    """
    program = recording.copy()
    answers: list[Array] = []
    for event in recording.replay(program):
        if isinstance(event, Matrices) or event.is_rehearsal:
            continue
        z, _, flag, info = daqp.solve(
            program.P,
            program.q,
            program.G,
            program.every_upper.copy(),
            program.every_lower.copy(),
            np.zeros(program.bounds.shape[1], dtype=np.intc),
            primal_tol=1e-10,
            dual_tol=1e-12,
        )
        error = optimality_error(program, z, np.asarray(info["lam"]))
        if flag != 1 or not error < CERTAIN:
            raise UncertainError(
                f"{recording.model}, {recording.scenario}, problem {len(answers)}: expected a "
                f"solution that meets the optimality conditions within {CERTAIN:g}, found "
                f"{error:.3g} (exit flag {flag})."
            )
        answers.append(z[:N_INPUTS].copy())
    return np.array(answers)


def optimality_error(program: QuadraticProgram, z: Array, multipliers: Array) -> float:
    """The worst violation of the KKT conditions.

    `multipliers` (n + r,), positive where an upper bound holds the solution back.
    """
    rows = np.vstack([np.eye(program.size), program.G])
    values = rows @ z
    stationarity = program.P @ z + program.q + rows.T @ multipliers
    above = np.maximum(values - program.every_upper, program.every_lower - values)
    bound = np.where(multipliers > 0.0, program.every_upper, program.every_lower)
    apart = np.abs(values - bound)[np.abs(multipliers) > 0.0]
    scale = max(1.0, float(np.abs(program.q).max()))
    return max(
        float(np.abs(stationarity).max()) / scale,
        float(above.max()),
        float(apart.max(initial=0.0)),
    )
