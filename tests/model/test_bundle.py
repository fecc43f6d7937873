"""The hash of a bundle, and the scaling of its errors."""

from dataclasses import replace

import numpy as np
import pytest

from rt_controller.contract.signals import VEHICLE
from rt_controller.model.follow import Follow
from rt_controller.model.lift import Lift


def test_growth_does_not_depend_on_the_units_of_an_observable(bundle):
    units = np.array([3.6, 1.0, 57.3, 1000.0, 1.0, 57.3, 1.0, 20.0, 0.1])
    other = replace(
        bundle,
        A=bundle.A * units[:, None] / units[None, :],
        selftest_psi=bundle.selftest_psi * units,
    )
    assert other.growth(20) == pytest.approx(bundle.growth(20))


def test_spread_is_the_standard_deviation_or_the_size_of_a_constant(bundle):
    psi = bundle.selftest_psi.copy()
    psi[:, 6] *= 1e-3
    psi[:, 7] = -3.0
    psi[:, 8] = 0.0
    spread = replace(bundle, selftest_psi=psi).spread
    np.testing.assert_array_equal(spread[:7], psi[:, :7].std(axis=0))
    np.testing.assert_array_equal(spread[7:], [3.0, 1.0])


def test_the_hash_changes_with_everything_that_affects_a_prediction(bundle):
    gains = bundle.gains
    assert gains is not None
    others = [
        replace(bundle, **{key: 0.9 * getattr(bundle, key)}) for key in ("A", "B_uc", "B_uw", "c")
    ]
    bent = [gains._replace(**{key: 0.9 * getattr(gains, key)}) for key in ("N", "S", "s0")]
    bent += [gains._replace(follows=follows) for follows in set(Follow) - {gains.follows}]
    bent += [gains._replace(**{key: getattr(gains, key)[::-1]}) for key in ("factor", "shape")]
    others += [replace(bundle, gains=changed) for changed in (*bent, None)]
    schemas = [
        replace(VEHICLE, states=VEHICLE.states[::-1]),
        replace(VEHICLE, inputs=VEHICLE.inputs[::-1]),
        replace(VEHICLE, exogenous=(VEHICLE.exogenous[0]._replace(unit="1/km"),)),
        replace(VEHICLE, dt_s=0.02),
    ]
    others += [replace(bundle, schema=schema) for schema in schemas]
    fields = bundle.lift.history_fields
    lifts = [Lift(), Lift(False, 4, fields), Lift(True, 5, fields)]
    lifts.append(Lift(True, 4, fields[1:]))
    others += [replace(bundle, lift=lift) for lift in lifts]
    others += [replace(bundle, encoder_onnx=b"another"), replace(bundle, name="another")]
    assert bundle.signal_range is not None
    others += [replace(bundle, signal_range=changed) for changed in (2 * bundle.signal_range, None)]
    assert len(others) == 24
    assert len({bundle.sha256, *(other.sha256 for other in others)}) == 25


def test_the_hash_does_not_depend_on_training_or_storage(bundle):
    stored = np.asfortranarray(bundle.A)
    other = replace(
        bundle,
        A=stored,
        training='{"seed": 1}',
        data_sha256="1" * 64,
        selftest_psi=bundle.selftest_psi + 1.0,
    )
    assert other.sha256 == bundle.sha256
