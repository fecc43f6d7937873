"""The QP with states as variables has the same first input as the condensed QP, within 1e-4."""

import numpy as np
import pytest
from random_problems import COST, HORIZON, optimum, random_bundle, update_vectors

from benchmarks.staged import StagedOsqp, StagedPiqp, StagedQp
from rt_controller.control.pedals import PedalChoice
from rt_controller.control.qp import CondensedQp
from rt_controller.control.solver import SolveStatus


@pytest.mark.parametrize("latent_weight", [0.0, 0.05])
@pytest.mark.parametrize("solver_type", [StagedPiqp, StagedOsqp])
def test_staged_and_condensed_qp_have_the_same_first_input(solver_type, latent_weight):
    if solver_type is StagedOsqp:
        pytest.importorskip("osqp", reason="the extra [peers] is not installed")
    rng = np.random.default_rng(3)
    bundle, cost = random_bundle(rng), COST._replace(latent_weight=latent_weight)
    condensed = CondensedQp(bundle, HORIZON, cost)
    staged = StagedQp(bundle, HORIZON, cost)
    program, solver = condensed.program, solver_type(staged)
    for _ in range(3):
        update_vectors(condensed, rng)
        staged.parameters.vector[:] = condensed.parameters.vector
        staged.update_vectors(PedalChoice())
        bounds = (program.row_lower, program.row_upper, program.lower, program.upper)
        exact = optimum(program.P, program.q, program.G, bounds, None, None)
        assert solver.solve() is SolveStatus.SOLVED
        np.testing.assert_allclose(solver.solution[:3], exact[:3], rtol=0.0, atol=1e-4)
