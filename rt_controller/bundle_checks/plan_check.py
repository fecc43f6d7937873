"""Stored plans of a bundle: made where it is exported, repeated before it drives.

A model whose files fit each other may still be another one than was exported: with a negated input
matrix and a new hash it steers the wrong way. Its plans differ from those that were stored.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import ControlInput, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.eq14 import TrackingCost
from rt_controller.control.mpc import Mpc
from rt_controller.control.program import SolveStatus
from rt_controller.control.warm_start import open_solver
from rt_controller.model.bundle import Bundle, PlanSample
from rt_controller.model.validation import find_objection_to_driving

HORIZON = 20
COST = TrackingCost(
    state=VehicleState(1.0, np.inf, np.inf, np.inf, 0.15, np.radians(1.0)),
    control=ControlInput(np.inf, np.inf, np.inf),
    control_change=ControlInput(0.3, 45.0, np.radians(12.0)),
    terminal_factor=1.0,
    heading="course",
)
"""of the stored plans, whatever the settings of a drive: a change makes all stored plans invalid"""
LARGEST_DIFFERENCE = 0.01
"""between two plans, of the range of each input; processors and solvers round differently"""
_PREVIOUS = ControlInput(0.1, 0.0, 0.0)
SITUATIONS = (
    # speed, e_y, e_psi, curvature; reference speed: pedals and steering both ways
    (16.7, 0.5, 0.0, 0.0, 16.7),
    (16.7, 0.0, -0.02, 0.0, 18.7),
    (22.2, -0.4, 0.01, 0.001, 22.2),
    (22.2, 0.0, 0.0, -0.002, 19.2),
    (33.3, 0.3, 0.005, 0.0005, 33.3),
)


def with_plans(bundle: Bundle) -> Bundle:
    """The bundle with stored plans; the same one if the controller cannot drive with it."""
    if find_objection_to_driving(bundle) is not None:
        return bundle
    vx, ey, epsi, curvature, v_ref = np.array(SITUATIONS).T
    zero = np.zeros(len(SITUATIONS))
    sample = PlanSample(
        state=np.stack([vx, zero, zero, vx * PERIOD_S, ey, epsi], axis=1),
        curvature_per_m=curvature,
        path=np.stack([zero, zero, zero, zero, v_ref, zero], axis=1),
        previous=np.array([_PREVIOUS] * len(SITUATIONS)),
        inputs=np.zeros((len(SITUATIONS), HORIZON, len(_PREVIOUS))),
    )
    return replace(bundle, plans=sample._replace(inputs=_plan(bundle, sample)))


def require_stored_plans(bundle: Bundle) -> None:
    """Refuse a bundle that does not plan as where it was exported; it may have no stored plans."""
    stored = bundle.plans
    if stored is None:
        return
    if stored.inputs.shape[1] != HORIZON:
        raise ArtifactError(
            f"The model {bundle.name!r}: expected stored plans of {HORIZON} periods, found plans "
            f"of {stored.inputs.shape[1]}. Run offline-export again."
        )
    span = np.subtract(INPUT_LIMITS.upper, INPUT_LIMITS.lower)
    differences = np.abs(_plan(bundle, stored) - stored.inputs) / span
    worst = float(np.max(differences, initial=0.0))
    if not worst <= LARGEST_DIFFERENCE:
        raise ArtifactError(
            f"The model {bundle.name!r}: expected the plans that were stored at its export within "
            f"{LARGEST_DIFFERENCE:g} of the range of each input, found a difference of "
            f"{worst:.2g}. The matrices or the encoder are not those that were exported: run "
            f"offline-export again."
        )


def _plan(bundle: Bundle, sample: PlanSample) -> np.ndarray:
    """(T, N, 3) plans in the situations of a sample, each without a past."""
    mpc = Mpc(bundle, HORIZON, COST, open_solver=partial(open_solver, warm_start=False))
    plans = []
    for state, curvature_per_m, path, previous in zip(*sample[:4], strict=True):
        applied = ControlInput(*previous.tolist())
        mpc.forget()
        mpc.resume(applied)
        x_0 = mpc.observer.observe(VehicleState(*state.tolist()), applied)
        reference = PathReference(*path.tolist())
        status = mpc.plan(x_0, float(curvature_per_m), reference, applied)
        if status is not SolveStatus.SOLVED:
            raise ArtifactError(
                f"The model {bundle.name!r}: expected a plan at {state[0]:.1f} m/s, found a QP "
                f"that is {status.name}. Run offline-export again, or choose another `model`."
            )
        plans.append(mpc.inputs.copy())
    return np.array(plans).reshape(sample.inputs.shape)
