"""Random condensed problems, and their solutions to high accuracy."""

import numpy as np
import piqp
from made_models import input_gains, join_gains, saturations

from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import ControlInput, VehicleState
from rt_controller.control.eq14 import CondensedQp, Corridor, TrackingCost
from rt_controller.control.pedals import PedalChoice
from rt_controller.control.piqp_solver import PiqpSolver
from rt_controller.control.program import QuadraticProgram
from rt_controller.model.bundle import Bundle
from rt_controller.model.lift import LiftSample

HORIZON = 12
N_OBSERVABLES = 10
COST = TrackingCost(
    state=VehicleState(1.0, 2.0, 0.3, 0.5, 0.2, 0.3),
    control=ControlInput(0.5, 60.0, 0.5),
    control_change=ControlInput(0.2, 40.0, 0.1),
    terminal_factor=2.0,
)
TIERS = {"slew rows": None, "corridor": Corridor(0.2, 0.05)}


GAIN = 0.3
"""of the gains of the inputs, relative to B_uc: with 1 the roll-out grows from stage to stage until
the Hessian has eigenvalues of 5e8, and no solver reaches the tolerances of `open_precise`"""


def random_bundle(rng: np.random.Generator, rank: int = 0, drift: int = 0) -> Bundle:
    """With as many gains of each input, and of the drift."""
    n = N_OBSERVABLES
    A = rng.normal(size=(n, n))
    A *= 0.97 / max(abs(np.linalg.eigvals(A)))
    size = np.array([0.3, 0.003, 0.4])
    of_inputs = input_gains(
        N=GAIN * rng.normal(size=(rank, n, 3)) * size,
        S=rng.normal(size=(rank, 3, n)),
        s0=rng.normal(size=(rank, 3)),
        saturates=True,
    )
    of_drift = saturations(
        N=0.03 * rng.normal(size=(n, drift)),
        S=rng.normal(size=(drift, n)),
        s0=rng.normal(size=drift),
        factor=4 - np.arange(drift) % 2,
        one=4,
    )
    gains = join_gains(of_inputs, of_drift)
    return Bundle(
        name="random",
        A=A,
        B_uc=rng.normal(size=(n, 3)) * size,
        B_uw=rng.normal(size=(n, 1)),
        c=0.05 * rng.normal(size=n),
        gains=gains if rank or drift else None,
        encoder_onnx=b"",
        selftest=LiftSample(np.zeros((1, 6)), np.zeros((1, 1)), np.zeros((1, 0, 0))),
        selftest_psi=np.zeros((1, n)),
        training="{}",
        data_sha256="",
    )


def optimum(
    P: Array, q: Array, G: Array, box: tuple[Array, ...], A: Array | None, b: Array | None
) -> Array:
    """The minimiser, to high accuracy; `box` bounds G x from both sides, then x."""
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = 1e-10
    solver.settings.eps_rel = 0.0
    solver.settings.eps_duality_gap_abs = 1e-11
    solver.settings.eps_duality_gap_rel = 1e-14  # costs may be of the order of 1e4
    equality = None if A is None else np.asfortranarray(A)
    rows = (np.asfortranarray(G), *box[:2]) if len(G) else (None, None, None)
    solver.setup(np.asfortranarray(P), q, equality, b, *rows, *box[2:])
    assert solver.solve() == piqp.PIQP_SOLVED
    return np.array(solver.result.x)


def open_precise(program: QuadraticProgram) -> PiqpSolver:
    """PIQP with tolerances of `optimum`, and iterations that suffice for them."""
    solver = PiqpSolver(program, max_iterations=50)
    settings = solver._workspace.settings
    settings.eps_abs, settings.eps_rel = 1e-10, 0.0
    settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = 1e-11, 1e-14
    return solver


def update_vectors(qp: CondensedQp, rng: np.random.Generator, size: float = 0.3) -> None:
    """Random parameters, and the matrices and vectors that follow."""
    qp.psi_0[:] = size * rng.normal(size=qp.psi_0.size)
    qp.kappa = 0.002
    qp.u_prev[:] = rng.uniform(INPUT_LIMITS.lower, INPUT_LIMITS.upper)
    qp.x_r[:] = size * rng.normal(size=qp.x_r.shape)
    own = rng.spawn(1)[0]  # for a model with drift alone: the others' problems stay the same
    qp.u_nominal[:] = own.uniform(INPUT_LIMITS.lower, INPUT_LIMITS.upper, size=qp.u_nominal.shape)
    qp.update_matrices()
    qp.update_vectors()
    qp.update_bounds(PedalChoice())
