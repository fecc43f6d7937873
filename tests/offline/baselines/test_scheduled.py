"""Linear models blended over speed, with a past, and with the exact path."""

from dataclasses import replace

import numpy as np
import pytest
from made_drives import SCHEMA, drive, predict, relative_error

from offline.baselines.fitting import log_error
from offline.baselines.linear import fit_linear
from offline.baselines.road_path import path_states, split_path
from offline.baselines.scheduled import ScheduledSettings, fit_scheduled, hat_functions
from offline.data.signals import past_names
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.signals import VEHICLE, Signal
from rt_controller.model.follow import Follow

B = np.array([[0.1, 0.0], [0.0, 0.02], [-0.05, 0.1]])
FEW = ScheduledSettings(ridges=(1e-12,))


def linear_step(x, u, w, u_before):
    return 0.95 * x + u @ B.T + 0.02 * w + 0.01


def slower_inputs(x, u, w, u_before):
    """The turn acts one period late."""
    return 0.95 * x + np.stack([u[:, 0], u_before[:, 1], u_before[:, 1]], axis=1) @ np.diag(
        [0.1, 0.02, 0.1]
    )


def speed_dependent(x, u, w, u_before):
    """The gain of the turn is proportional to the speed, which follows the push."""
    speed, level, swing = x.T
    push, turn = u.T
    return np.stack([0.98 * speed + 0.05 * push, level, 0.9 * swing + 0.3 * speed * turn], axis=1)


def test_one_knot_without_a_past_is_least_squares():
    data = drive(linear_step)
    model, expected = fit_scheduled(data, FEW), fit_linear(data)
    one, _ = predict(model, data.select("test"))
    other, _ = predict(expected, data.select("test"))
    assert np.allclose(one, other, atol=1e-4)


def test_a_past_explains_a_late_input():
    data = drive(slower_inputs)
    test = data.select("test")
    without = fit_scheduled(data, FEW)
    model = fit_scheduled(data, replace(FEW, past_steps=(1, 2)))
    assert np.all(relative_error(model, test) < 1e-3)
    assert log_error(model, test) < log_error(without, test) - 2.0


def test_knots_explain_a_gain_that_depends_on_speed():
    data = drive(speed_dependent)
    test = data.select("test")
    one, blended = fit_scheduled(data, FEW), fit_scheduled(data, replace(FEW, knots=(2,)))
    assert relative_error(blended, test)[2] < 0.1 * relative_error(one, test)[2]
    assert blended.structure.follows is Follow.PREDICTION


def test_the_settings_are_those_of_the_smallest_validation_error():
    data = drive(speed_dependent)
    settings = replace(FEW, knots=(1, 2), past_steps=(0, 1), ridges=(1e-12, 10.0))
    chosen = fit_scheduled(data, settings)
    assert len(chosen.structure.knots) == 2
    assert chosen.ridge == 1e-12


def test_hat_functions_are_one_at_their_knot_and_constant_beyond():
    knots = np.array([-1.0, 0.0, 2.0])
    found = hat_functions(np.array([-3.0, -1.0, -0.5, 0.0, 1.0, 2.0, 7.0]), knots)
    expected = [[1, 0, 0], [1, 0, 0], [0.5, 0.5, 0], [0, 1, 0], [0, 0.5, 0.5], [0, 0, 1], [0, 0, 1]]
    assert np.allclose(found, expected)
    assert np.allclose(hat_functions(np.array([-3.0, 4.0]), np.zeros(1)), 1.0)


def test_without_a_centred_state_or_with_one_speed_there_is_one_knot():
    data = drive(speed_dependent)
    roles = replace(data.roles, centred=())
    without = replace(data, manifest=replace(data.manifest, roles=roles))
    assert len(fit_scheduled(without, replace(FEW, knots=(4,))).structure.knots) == 1
    recording = data.recording._replace(x=data.recording.x * np.float32([0, 1, 1]))
    same_speed = replace(data, recording=recording)
    assert len(fit_scheduled(same_speed, replace(FEW, knots=(4,))).structure.knots) == 1


def test_data_that_no_model_predicts_are_refused():
    data = drive(speed_dependent)
    settings = replace(FEW, ridges=())
    with pytest.raises(DatasetError, match="found none"):
        fit_scheduled(data, settings)


def test_the_path_of_the_car_follows_from_the_motion(toy_dataset):
    model = fit_scheduled(toy_dataset, replace(FEW, knots=(3,), past_steps=(2,)))
    assert model.theta.shape == (3, 3, 3 + 2 * 6 + 3 + 1)
    windows = toy_dataset.select("test")
    x, u, w, past = (series.astype(np.float64) for series in windows[:4])
    states = model.predict(x[:, 0], past, u, w)
    path = path_states(np, states[..., :3], x[:, 0], w[..., 0], 0.025)
    assert np.allclose(states[:, 1:, 3:], path)


def test_the_path_is_split_off_only_if_there_is_one():
    assert split_path(VEHICLE) == (3, (), 0)
    friction = Signal("friction", "1")
    more = replace(VEHICLE, exogenous=(friction, *VEHICLE.exogenous))
    assert split_path(more) == (3, (0,), 1)
    assert split_path(SCHEMA) == (3, (0,), None)
    assert split_path(replace(VEHICLE, exogenous=(friction,))) == (6, (0,), None)


def test_the_roll_out_is_the_recursion_of_the_docstring(toy_dataset):
    """Against one window, one step and one regressor at a time."""
    model = fit_scheduled(toy_dataset, replace(FEW, knots=(3,), past_steps=(2,)))
    s, scaling = model.structure, model.structure.scaling
    windows = toy_dataset.select("test").take(slice(0, 1))
    x, u, w, past = (series.astype(np.float64) for series in windows[:4])
    expected = scaling.normalise_states(x[0, 0])[:3]
    rows = [(row - scaling.past_centre) / scaling.past_scale for row in past[0, -2:]]
    found = model.predict(x[:, 0], past, u, w)[0]
    for k in range(5):
        inputs = u[0, k] / scaling.u_scale
        z = [*expected, *rows[-2][:3], *rows[-1][:3], *rows[-2][3:], *rows[-1][3:], *inputs, 1.0]
        phi = hat_functions(expected[:1], s.knots)[0]
        rows.append(np.concatenate([expected, inputs]))
        expected = expected + sum(phi[j] * model.theta[j] @ np.array(z) for j in range(3))
        physical = expected * scaling.x_scale[:3] + scaling.x_centre[:3]
        assert np.allclose(found[k + 1, :3], physical)
    assert past_names(s.schema, s.roles)[:3] == s.schema.state_names[:3]


def test_the_report_names_knots_in_physical_units():
    data = drive(speed_dependent)
    model = fit_scheduled(data, replace(FEW, knots=(2,)))
    facts = {fact.name: fact.value for fact in model.fit_info()}
    speed = data.select("train").x[:, 0, 0]
    first, last = (float(each) for each in facts["knots of speed_mps"].split(","))
    assert first == pytest.approx(np.quantile(speed, 0.01), rel=0.02)
    assert last == pytest.approx(np.quantile(speed, 0.99), rel=0.02)
    assert facts["path"] == "learned"
