"""The model along a plan is its own roll-out, and its Jacobian that of one step."""

import numpy as np
import pytest
from made_models import RANGE, VARIANTS, WITH_ALL, knots_of, made

from rt_controller.contract.signals import N_STATES
from rt_controller.control.eq14 import Linearisation
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.dynamics import Step

HORIZON, CURVATURE_PER_M = 20, 0.002
BUNDLES = {name: lambda name=name: made(name) for name in VARIANTS}
BUNDLES |= {f"{name}, history": lambda name=name: made(name, lift=WITH_ALL) for name in VARIANTS}
for name in ("lti", "mdk-net", "mdk-net-paper"):
    BUNDLES[name] = lambda name=name: load_bundle(shipped_model(name))


@pytest.mark.parametrize("bundle", BUNDLES.values(), ids=BUNDLES)
def test_the_products_with_the_jacobian_are_finite_differences_of_a_step(bundle):
    bundle, rng = bundle(), np.random.default_rng(3)
    step, inputs = Step(bundle), knots_of(HORIZON)
    after = rng.normal(size=(3, N_STATES)) @ np.eye(N_STATES, bundle.n_observables)  # rows y
    for psi_0 in bundle.selftest_psi[:2]:
        found = Linearisation(bundle, HORIZON, range(N_STATES))
        found.update(psi_0, inputs, CURVATURE_PER_M)
        psi = psi_0
        for k, u in enumerate(inputs):
            np.testing.assert_allclose(found.psi[k], psi, rtol=1e-12, atol=1e-12)
            at = np.array([*u, CURVATURE_PER_M, 1.0])
            by_psi, by_input = found.times_jacobian(after, k)
            for _ in range(3):
                d_psi = 1e-5 * bundle.spread * rng.normal(size=psi.size)
                d_at = np.array([*(1e-5 * RANGE * rng.normal(size=3)), 1e-7, 0.0])
                change = 0.5 * after @ (step(psi + d_psi, at + d_at) - step(psi - d_psi, at - d_at))
                expected = by_psi @ d_psi + by_input @ d_at[:4]
                np.testing.assert_allclose(change, expected, atol=1e-6 * np.abs(change).max())
            psi = step(psi, at)
