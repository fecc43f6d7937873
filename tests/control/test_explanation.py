"""The explanation of a plan agrees with the QP that was solved."""

import numpy as np
import pytest

from rt_controller.config import MpcSettings
from rt_controller.contract.signals import N_STATES, ControlInput, PathReference, VehicleState
from rt_controller.control.explanation import cost_shares
from rt_controller.control.mpc import Mpc
from rt_controller.control.program import SolveStatus
from rt_controller.control.terms import Corridor, Heading
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.dynamics import roll_out

STATE = VehicleState(21.0, 0.1, 0.05, 0.52, -0.6, 0.02)
PATH = PathReference(0.0, 0.01, 0.0, 0.0, 20.5, 0.0)
PREVIOUS = ControlInput(0.2, 0.0, 0.05)
DEFAULT = MpcSettings()


def planned(corridor: Corridor | None = None, settings: MpcSettings = DEFAULT) -> Mpc:
    bundle, knots = load_bundle(shipped_model("lti")), settings.knots
    mpc = Mpc(bundle, settings.horizon, settings.cost(), corridor, knots=knots)
    assert mpc.plan(STATE, 0.001, PATH, PREVIOUS) is SolveStatus.SOLVED
    return mpc


@pytest.mark.parametrize("heading", ["course", "epsi"])
@pytest.mark.parametrize("corridor", [None, Corridor(0.3, 0.05)])
def test_the_cost_shares_add_up_to_the_objective_of_the_qp(
    corridor: Corridor | None, heading: Heading
) -> None:
    """Of a linear model: the objective is the sum without what does not depend on the inputs."""
    settings = MpcSettings(heading=heading)
    mpc = planned(corridor, settings)
    costs = mpc.explain_plan().costs
    program, parameters, bundle = mpc._qp.program, mpc._qp.parameters, mpc._bundle
    nothing, knots = np.zeros_like(mpc.inputs), mpc._qp.knots
    W = np.full((1, len(nothing), 1), 0.001)
    (free,) = roll_out(bundle, parameters.psi[None], nothing[None], W, N_STATES)
    without = cost_shares(
        settings.cost(),
        None,
        free[[0, *knots.ends]],
        parameters,
        nothing,
        mpc._qp.objective.length_m,
        knots.intervals,
    )
    z = mpc._solver.solution
    objective = 0.5 * z @ program.P @ z + program.q @ z
    difference = sum(each.cost for each in costs) - sum(each.cost for each in without)
    assert difference == pytest.approx(objective, rel=1e-6)
    assert sum(each.share for each in costs) == pytest.approx(1.0)
    assert ("beyond the corridor" in {each.term for each in costs}) is (corridor is not None)


def test_the_second_solution_is_the_first_one() -> None:
    mpc = planned()
    second = mpc.explain_plan().second
    assert second.status is SolveStatus.SOLVED
    assert second.largest_difference < 1e-4
    assert second.optimality_residual < 1e-7 * np.abs(mpc._qp.program.q).max()


def test_active_bounds_are_named_with_signal_stage_and_side() -> None:
    mpc = planned()
    active, mpc_stages = mpc.explain_plan().active, mpc._qp.knots.stages
    first = {(each.kind, each.signal, each.side) for each in active if each.stage == 0}
    assert ("change", "steer_rad", "upper") in first
    assert ("value", "brake_n", "both") in first
    assert {each.stage for each in active} <= set(mpc_stages)
    for each in active:
        sign = {"upper": 1.0, "lower": -1.0, "both": 0.0}[each.side]
        assert sign * each.multiplier >= -1e-8


def test_a_plan_that_failed_is_explained_by_the_second_solve() -> None:
    mpc = planned()
    nowhere = STATE._replace(ey_m=float("nan"))
    assert mpc.plan(nowhere, 0.001, PATH, PREVIOUS) is not SolveStatus.SOLVED
    found = mpc.explain_plan()
    assert found.second.status is not SolveStatus.SOLVED
    assert np.isnan(found.inputs).all()
    assert found.costs == ()
