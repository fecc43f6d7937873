"""Scaling: unit spread, and zero stays zero except for centred signals."""

from dataclasses import replace

import numpy as np
import pytest

from offline.data.manifest import PARTS
from offline.data.signals import (
    VEHICLE_ROLES,
    Scaling,
    Trajectories,
    fit_scaling,
    mirror_signs,
    signal_range,
)
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import VEHICLE, Signal


def fit(trajectories: Trajectories) -> Scaling:
    return fit_scaling(trajectories, VEHICLE, VEHICLE_ROLES)


@pytest.fixture(scope="module")
def train(toy_dataset) -> Trajectories:
    return toy_dataset.select("train")


def everything(dataset) -> Trajectories:
    parts = [dataset.select(part) for part in PARTS]
    return Trajectories(
        *(np.concatenate(arrays) for arrays in zip(*parts, strict=True) if arrays[0] is not None)
    )


def root_mean_square(rows: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(rows.reshape(-1, rows.shape[-1]).astype(float) ** 2, axis=0))


def test_scaled_training_data_have_unit_spread(train):
    scaling = fit(train)
    assert np.allclose(root_mean_square(scaling.normalise_states(train.x)), 1.0, rtol=1e-6)
    assert np.allclose(root_mean_square(train.u / scaling.u_scale), 1.0, rtol=1e-6)
    assert np.allclose(root_mean_square(train.w / scaling.w_scale), 1.0, rtol=1e-6)


def test_only_speed_and_progress_are_centred(train):
    scaling = fit(train)
    assert np.flatnonzero(scaling.x_centre).tolist() == [0, 3]
    assert scaling.x_centre[0] == pytest.approx(train.x[..., 0].mean(), rel=1e-5)


def test_the_roles_decide_which_signals_are_centred(train):
    roles = replace(VEHICLE_ROLES, centred=("ey_m",), odd=None)
    scaling = fit_scaling(train, VEHICLE, roles)
    assert np.flatnonzero(scaling.x_centre).tolist() == [4]


def test_scaling_keeps_the_mirror_symmetry(train):
    mirror = mirror_signs(VEHICLE.state_names, VEHICLE_ROLES)
    scaling = fit(train)
    found = scaling.normalise_states(train.x * mirror)
    assert np.allclose(found, scaling.normalise_states(train.x) * mirror)


def test_the_past_is_scaled_like_the_same_signals_in_the_present(train):
    """(v_x, v_y, yaw rate; throttle, brake, steering)."""
    scaling = fit(train)
    assert np.array_equal(scaling.past_centre, [scaling.x_centre[0], 0, 0, 0, 0, 0])
    assert np.array_equal(scaling.past_scale, [*scaling.x_scale[:3], *scaling.u_scale])


def test_the_past_has_the_signals_that_the_roles_name(train):
    roles = replace(VEHICLE_ROLES, past=("ds_m", "steer_rad"))
    scaling = fit_scaling(train, VEHICLE, roles)
    assert np.array_equal(scaling.past_centre, [scaling.x_centre[3], 0.0])
    assert np.array_equal(scaling.past_scale, [scaling.x_scale[3], scaling.u_scale[2]])


def test_only_the_training_part_determines_the_scaling(toy_dataset, train):
    assert not np.allclose(fit(everything(toy_dataset)).x_scale, fit(train).x_scale)


def test_a_constant_signal_has_scale_one(train):
    still = train._replace(u=np.zeros_like(train.u), w=np.zeros_like(train.w))
    scaling = fit(still)
    assert np.array_equal(scaling.u_scale, np.ones(3))
    assert np.array_equal(scaling.w_scale, np.ones(1))


def test_a_constant_centred_signal_becomes_zero(train):
    x = train.x.copy()
    x[..., 0] = 20.0
    scaling = fit(train._replace(x=x))
    assert (scaling.x_centre[0], scaling.x_scale[0]) == (20.0, 1.0)
    assert np.all(scaling.normalise_states(x)[..., 0] == 0.0)


def test_scaling_without_exogenous_signals_is_empty_for_them(train):
    scaling = fit(train._replace(w=train.w[..., :0]))
    assert scaling.w_scale.shape == (0,)


def test_the_scale_of_an_input_or_road_is_at_least_a_third_of_its_peak(train):
    u, w = 0.0 * train.u, 0.0 * train.w
    u[0, 0, 1], w[0, 0, 0] = -120.0, 0.03
    scaling = fit(train._replace(u=u, w=w))
    assert scaling.u_scale[1] == pytest.approx(40.0)
    assert scaling.w_scale[0] == pytest.approx(0.01)


def test_the_scale_of_a_state_is_at_least_a_tenth_of_its_peak(train):
    x = 0.0 * train.x
    x[0, 0, 1] = 5.0
    assert fit(train._replace(x=x)).x_scale[1] == pytest.approx(0.5)


def test_the_range_of_the_inputs_of_the_car_is_its_limits_and_that_of_a_road_is_found(train):
    lowest, highest = signal_range(train, VEHICLE)
    assert lowest.tolist() == [*INPUT_LIMITS.lower, train.w.min()]
    assert highest.tolist() == [*INPUT_LIMITS.upper, train.w.max()]


def test_the_range_of_other_inputs_is_found(train):
    other = replace(VEHICLE, inputs=(Signal("valve", "1"), *VEHICLE.inputs[1:]))
    lowest, highest = signal_range(train, other)
    assert lowest.tolist() == [*train.u.min(axis=(0, 1)), train.w.min()]
    assert highest.tolist() == [*train.u.max(axis=(0, 1)), train.w.max()]


def test_without_exogenous_signals_the_range_is_that_of_the_inputs(train):
    assert signal_range(train._replace(w=train.w[..., :0]), VEHICLE).shape == (2, 3)
