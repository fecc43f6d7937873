"""Time of the parts of a plan, called in a row."""

import numpy as np
import pytest

from benchmarks.figures.closed_loop import RIVALS
from benchmarks.tables import percentiles
from rt_controller.config import MpcSettings
from rt_controller.contract.signals import ControlInput, PathReference, VehicleState
from rt_controller.control.lift import Encoder
from rt_controller.control.mpc import Mpc
from rt_controller.control.pedals import PedalChoice
from rt_controller.control.program import SolveStatus
from rt_controller.control.qp import CondensedQp
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.bundle import Bundle

STATE = VehicleState(22.0, -0.05, 0.06, 0.55, 1.2, 0.07)
PATH = PathReference(1.3, 0.09, 0.004, -0.0004, 22.2, 0.0)
PREVIOUS = ControlInput(0.15, 0.0, 0.2)


@pytest.fixture(params=["mdk-net", "mdk-net-paper", "lti"])
def bundle(request: pytest.FixtureRequest) -> Bundle:
    """The shipped models: bilinear, linear with latents, linear."""
    return load_bundle(shipped_model(request.param))


def test_lift(benchmark, bundle: Bundle) -> None:
    encoder = Encoder(bundle)
    assert benchmark(encoder.lift, STATE, 0.001).shape == (bundle.n_observables,)


def test_update_vectors(benchmark, bundle: Bundle) -> None:
    """From the parameters to the vectors of the QP."""
    settings = MpcSettings()
    qp = CondensedQp(bundle, settings.horizon, settings.cost())
    benchmark(qp.update_vectors, PedalChoice())
    assert np.all(np.isfinite(qp.program.q))


def test_plan(benchmark, bundle: Bundle) -> None:
    """Lift, reference, matrices, vectors and solve; the time of the solve is in `extra_info`."""
    settings = MpcSettings()
    mpc = Mpc(bundle, settings.horizon, settings.cost())
    solve_us: list[float] = []

    def plan() -> SolveStatus:
        status = mpc.plan(STATE, 0.001, PATH, PREVIOUS)
        solve_us.append(mpc.solve_ns / 1e3)
        return status

    assert benchmark(plan) is SolveStatus.SOLVED
    benchmark.extra_info.update(percentiles(solve_us, "qp_"))
    benchmark.extra_info["qp_iterations"] = mpc.iterations


@pytest.mark.parametrize("name", RIVALS)
def test_plan_of_a_rival(benchmark, name: str) -> None:
    """The same with other controllers; that of nonlinear MPC has several linearisations."""
    pytest.importorskip("casadi", reason="the extra [peers] is not installed")
    from benchmarks.rivals.drive import build_rival, tuned_values

    rival = build_rival(name, tuned_values(name))
    assert benchmark(rival.plan, STATE, 0.001, PATH, PREVIOUS) is SolveStatus.SOLVED


def test_assembly(benchmark, bundle: Bundle) -> None:
    """Assembly of the controller at start."""
    settings = MpcSettings()
    benchmark(Mpc, bundle, settings.horizon, settings.cost())
