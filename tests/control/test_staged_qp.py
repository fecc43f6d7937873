"""The QP with states has the inputs of the one without, and is chosen where it is faster."""

from dataclasses import replace

import numpy as np
import pytest
from random_problems import COST, HORIZON, TIERS, aim, optimum, random_bundle

from rt_controller.config import MpcSettings
from rt_controller.contract.artifact import load_bundle
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.control.formulation import Formulation, Solving, formulate, prefers_stages
from rt_controller.control.pedals import PedalChoice
from rt_controller.control.qp import WITH_SLEW, CondensedQp
from rt_controller.control.solver import SolveStatus
from rt_controller.control.solvers import SolverChoice
from rt_controller.control.staged_qp import StagedQp
from rt_controller.control.staged_solver import StagedSolver
from rt_controller.session import shipped_model


@pytest.mark.parametrize("features", TIERS.values(), ids=TIERS.keys())
@pytest.mark.parametrize("latent_weight", [0.0, 0.05])
def test_both_forms_have_the_same_inputs(features, latent_weight):
    rng = np.random.default_rng(3)
    bundle, cost = random_bundle(rng), COST._replace(latent_weight=latent_weight)
    condensed = CondensedQp(bundle, HORIZON, cost, INPUT_LIMITS, features)
    staged = StagedQp(bundle, HORIZON, cost, INPUT_LIMITS, features)
    solver, program = StagedSolver(staged), condensed.program
    for _ in range(10):
        aim(condensed, rng)
        staged.situation.vector[:] = condensed.situation.vector
        staged.aim(PedalChoice())
        assert solver.solve() is SolveStatus.SOLVED
        bounds = (program.row_lower, program.row_upper, program.lower, program.upper)
        exact = optimum(program.P, program.q, program.G, bounds, None, None)
        np.testing.assert_allclose(solver.solution[:3], exact[:3], rtol=0.0, atol=1e-4)


def test_what_is_not_a_number_is_not_solved():
    bundle = random_bundle(np.random.default_rng(0))
    staged = StagedQp(bundle, HORIZON, COST, INPUT_LIMITS, WITH_SLEW)
    solver = StagedSolver(staged)
    for spoilt in (staged.situation.psi, staged.situation.reference, staged.situation.previous):
        spoilt[0] = np.nan
        staged.aim(PedalChoice())
        assert solver.solve() is SolveStatus.NUMERICS
        spoilt[0] = 0.0
        staged.aim(PedalChoice())
        assert solver.solve() is SolveStatus.SOLVED


def test_a_long_horizon_of_a_small_model_has_stages_and_no_other():
    small, lifted = (load_bundle(shipped_model(name)) for name in ("lti", "mdk-net-paper"))
    assert not prefers_stages(small, 20)
    assert prefers_stages(small, 80)
    assert not prefers_stages(lifted, 160)
    assert not prefers_stages(load_bundle(shipped_model("mdk-net")), 160)
    for horizon, kind in ((20, CondensedQp), (80, StagedQp)):
        problem, _ = formulate(small, horizon, COST, INPUT_LIMITS, WITH_SLEW, Solving())
        assert isinstance(problem, kind)


def test_stages_are_refused_where_they_cannot_be():
    lti = load_bundle(shipped_model("lti"))
    bilinear = replace(lti, bilinear=load_bundle(shipped_model("mdk-net")).bilinear)
    with pytest.raises(ConfigError, match="formulation condensed"):
        formulate(bilinear, 20, COST, INPUT_LIMITS, WITH_SLEW, Solving(Formulation.STAGED))
    staged = MpcSettings(formulation=Formulation.STAGED)
    assert staged.solving().formulation is Formulation.STAGED
    daqp = staged.model_copy(update={"solver": SolverChoice.DAQP})
    with pytest.raises(ConfigError, match="the solver piqp"):
        daqp.solving()
    assert MpcSettings(solver=SolverChoice.DAQP).solving().formulation is Formulation.CONDENSED
