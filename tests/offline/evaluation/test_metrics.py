"""Prediction errors in the units of the paper's Table I."""

import numpy as np
import pytest
from toy_predictors import WithError, made_test_set, made_trajectories, with_random_error

from offline.evaluation import predictor
from offline.evaluation.comparison import compare_models
from offline.evaluation.metrics import (
    MEANS,
    SHARES,
    StateUnit,
    TrajectoryErrors,
    errors_on,
    geometric_mean,
    ratios_of,
    state_units,
)
from offline.evaluation.predictor import prediction_errors
from rt_controller.contract.signals import VEHICLE, Schema, Signal

CAR = state_units(VEHICLE)


def figures_of(model, test, schema=VEHICLE):
    """Figures of the library, of a model on this test set."""
    return compare_models({"m": model}, {}, [test], schema).library


def values(by_state, part="value"):
    return [each[part] for each in by_state.values()]


def mse_of(model, test, schema=VEHICLE):
    return values(figures_of(model, test, schema)["models"]["m"]["mse"])


def test_errors_are_in_the_squared_units_of_the_papers_table():
    """Errors of 1 m/s, 1 rad/s, 1 m and 1 rad everywhere."""
    made = made_trajectories(10)
    model = WithError(made, [1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
    found = figures_of(model, made_test_set(made))["models"]["m"]
    degrees = np.degrees(1.0) ** 2
    assert np.allclose(values(found["mse"]), [12.96, 12.96, degrees, 1.0, 1.0, degrees])
    assert np.allclose(values(found["rms"]), np.sqrt(values(found["mse"])))


def test_the_first_state_does_not_count():
    made = made_trajectories(10)
    error = np.zeros(made.x.shape)
    error[:, 0] = 1e6
    assert mse_of(WithError(made, error), made_test_set(made)) == [0.0] * 6


def test_states_of_any_schema_have_errors():
    schema = Schema(
        (Signal("speed_mps", "m/s"), Signal("heat_k", "K")), (Signal("power", "1"),), (), 0.1
    )
    made = made_trajectories(10, steps=30, states=2)
    found = figures_of(WithError(made, [1.0, 2.0]), made_test_set(made), schema)
    assert np.allclose(values(found["models"]["m"]["mse"]), [12.96, 4.0])
    assert list(found["absolute_error_quantiles"]["m"]) == ["after_2_s"]


def test_rms_error_is_given_for_each_step():
    """An error of k metres at step k."""
    made = made_trajectories(20)
    error = np.zeros(made.x.shape)
    error[..., 4] = np.arange(81)
    by_step = figures_of(WithError(made, error), made_test_set(made))["by_step"]["m"]["rms"]
    assert np.allclose(by_step["ey_m"]["value"], np.arange(1, 81))
    assert np.allclose(by_step["ey_m"]["low"], np.arange(1, 81))
    assert by_step["vx_kmh"]["value"] == [0.0] * 80


def test_all_trajectories_have_the_same_weight_in_episodes_of_any_length():
    made = made_trajectories(4)
    made = made._replace(episode=np.array([0, 0, 0, 1], dtype=np.int32))
    error = np.zeros(made.x.shape)
    error[3, :, 3] = 2.0
    assert mse_of(WithError(made, error), made_test_set(made))[3] == pytest.approx(1.0)


def test_quantiles_are_of_the_absolute_errors_of_the_trajectories():
    """Errors of -1, -2, ... -100 m: half of them are at most 50 m."""
    made = made_trajectories(100)
    error = np.zeros(made.x.shape)
    error[..., 4] = -np.arange(1.0, 101.0)[:, None]
    found = figures_of(WithError(made, error), made_test_set(made))
    by_step = found["by_step"]["m"]["absolute_error"]
    assert [by_step[share]["ey_m"][7] for share in by_step] == pytest.approx([50.0, 90.0, 99.0])
    marked = found["absolute_error_quantiles"]["m"]
    assert list(marked) == ["after_0.5_s", "after_1_s", "after_2_s"]
    shares = [each["ey_m"] for each in marked["after_1_s"].values()]
    assert [each["value"] for each in shares] == pytest.approx([50.0, 90.0, 99.0])
    assert all(each["low"] < each["value"] for each in shares)
    assert all(each["value"] < each["high"] for each in shares[:2])


def test_pooled_errors_are_the_mean_of_those_on_each_road():
    made = made_trajectories(40)
    test = made_test_set(made, np.repeat([-1e-3, 0.0], [30, 10]))
    found = figures_of(with_random_error(made), test)["models"]["m"]
    right, straight = map(np.array, map(values, found["mse_by_curvature_per_m"].values()))
    assert np.allclose(0.75 * right + 0.25 * straight, values(found["mse"]))
    assert not np.allclose(right, straight)


def test_diverging_predictions_have_infinite_errors_and_are_counted():
    made = made_trajectories(20)
    error = np.zeros(made.x.shape)
    error[3, 40:, 0] = np.inf
    error[4, 40:, 0] = np.nan
    error[5, :, 1] = 1e200  # finite, but not its square
    found = figures_of(WithError(made, error), made_test_set(made))
    model = found["models"]["m"]
    assert model["trajectories_without_finite_prediction"] == 2
    assert np.isinf(values(model["mse"])).tolist() == [True, True, False, False, False, False]
    by_step = np.array(found["by_step"]["m"]["rms"]["vx_kmh"]["value"])
    assert np.all(by_step[:39] == 0.0)
    assert np.all(np.isinf(by_step[39:]))


def test_batches_of_a_long_test_set_give_the_same_errors(monkeypatch):
    made = made_trajectories(23)
    model = with_random_error(made)
    at_once = prediction_errors(model, made)
    monkeypatch.setattr(predictor, "_BATCH", 10)
    assert np.array_equal(prediction_errors(model, made), at_once)
    assert at_once.shape == (23, 80, 6)


def test_a_model_gets_the_inputs_curvature_and_past_of_each_trajectory():
    made = made_trajectories(3)
    seen = {}

    class Watching:
        def predict(self, x0, past, U, W):
            seen.update(x0=x0, past=past, U=U, W=W)
            return made.x.astype(float)

    errors_on(Watching(), made_test_set(made), CAR)
    assert np.array_equal(seen["x0"], made.x[:, 0])
    for name, array in (("past", made.past), ("U", made.u), ("W", made.w)):
        assert np.array_equal(seen[name], array)
        assert seen[name].dtype == np.float64


def units_of(*states):
    return state_units(Schema(tuple(Signal(*state) for state in states), (), (), 0.1))


def test_states_of_the_car_have_the_units_of_the_papers_table():
    columns = state_units(VEHICLE)
    assert [column.name for column in columns] == ["vx", "vy", "yaw_rate", "ds", "ey", "epsi"]
    assert [column.unit for column in columns] == ["km/h", "km/h", "deg/s", "m", "m", "deg"]
    assert [column.squared_unit for column in columns] == [
        "(km/h)^2", "(km/h)^2", "(deg/s)^2", "m^2", "m^2", "deg^2",
    ]  # fmt: skip
    degrees = float(np.degrees(1.0))
    assert [column.per_si for column in columns] == [3.6, 3.6, degrees, 1.0, 1.0, degrees]


def test_json_keys_end_in_the_unit():
    columns = state_units(VEHICLE)
    assert [column.key for column in columns][:4] == ["vx_kmh", "vy_kmh", "yaw_rate_degps", "ds_m"]
    assert columns[2].squared_key == "yaw_rate_degps_squared"


@pytest.mark.parametrize(
    ("state", "name", "unit", "key"),
    [
        (("temperature_k", "K"), "temperature", "K", "temperature_k"),
        (("ax_mps2", "m/s^2"), "ax", "m/s^2", "ax_mps2"),
        (("curvature_per_m", "1/m"), "curvature", "1/m", "curvature_per_m"),
        (("gear", "1"), "gear", "1", "gear"),
        (("charge", ""), "charge", "", "charge"),
        (("speed", "m/s"), "speed", "km/h", "speed_kmh"),
    ],
)
def test_other_states_keep_their_unit_unless_it_is_m_per_s_or_rad(state, name, unit, key):
    (column,) = units_of(state)
    assert (column.name, column.unit, column.key) == (name, unit, key)


def test_a_state_without_a_unit_has_none_when_squared():
    assert units_of(("gear", "1"), ("charge", ""))[0].squared_unit == "1"


def test_an_error_is_averaged_over_the_steps_of_its_trajectory():
    """An error of k metres at step k of trajectory 3 only."""
    made = made_trajectories(20)
    error = np.zeros(made.x.shape)
    error[3, :, 4] = np.arange(81)
    _, found = errors_on(WithError(made, error), made_test_set(made), CAR)
    assert found.mse[3, 4] == pytest.approx(np.square(np.arange(1, 81)).mean())
    assert np.count_nonzero(found.mse) == 1


def test_one_bad_trajectory_moves_the_mean_and_not_the_median():
    mse = np.ones((200, 2))
    mse[17, 0] = 1e4
    found = TrajectoryErrors(mse, np.arange(200, dtype=np.int32) // 5)
    assert found.mean_draws[0] == pytest.approx([50.995, 1.0])
    assert np.all(found.quantile_draws[0, SHARES.index(0.5)] == 1.0)
    assert np.all(found.quantile_draws[0, SHARES.index(0.99)] == 1.0)
    assert found.worst_part().value == pytest.approx([10_001 / 10_199, 0.01])


def test_a_prediction_that_is_not_finite_has_infinite_error_and_no_part_of_the_sum():
    made = made_trajectories(20)
    error = np.ones(made.x.shape)
    error[3, 40:, 0] = np.nan
    _, found = errors_on(WithError(made, error), made_test_set(made), CAR)
    assert np.isinf(found.mse[3, 0])
    assert np.isinf(found.mean_draws[0, 0])
    assert found.quantile_draws[0, 0, 0] == pytest.approx(3.6**2)
    assert np.isnan(found.worst_part().value[0])
    assert np.isfinite(found.worst_part().value[1])


def test_some_of_the_trajectories_keep_their_errors_and_episodes():
    errors = TrajectoryErrors(np.arange(8.0).reshape(4, 2), np.array([0, 0, 1, 1], dtype=np.int32))
    found = errors.take(np.array([False, True, True, False]))
    assert found.mse.tolist() == [[2.0, 3.0], [4.0, 5.0]]
    assert found.episode.tolist() == [0, 1]


def draws(*values, count=5):
    return np.tile(np.array(values, dtype=float), (count, 1))


def means(found):
    return [found[name]["value"] for name in MEANS if name in found]


def test_the_second_mean_leaves_out_progress():
    """Progress, the fourth state, has the only error."""
    one = draws(1, 1, 1, 1, 1, 1)
    assert means(ratios_of(draws(1, 1, 1, 64, 1, 1), one, CAR)) == pytest.approx([2.0, 1.0])
    assert means(ratios_of(draws(32, 1, 1, 64, 1, 1), one, CAR))[1] == pytest.approx(2.0)


def test_states_without_progress_have_one_mean():
    columns = (StateUnit("speed", "km/h", 3.6), StateUnit("heat", "K", 1.0))
    assert means(ratios_of(draws(4, 1), draws(1, 1), columns)) == pytest.approx([2.0])
    assert len(means(ratios_of(draws(4), draws(1), (StateUnit("ds", "m", 1.0),)))) == 1


def test_a_ratio_to_a_single_episode_has_no_interval():
    many = np.random.default_rng(0).uniform(1.0, 2.0, (2001, 6))
    found = ratios_of(draws(1, 1, 1, 1, 1, 1, count=1), many, CAR)
    assert np.isnan([*values(found, "low"), *values(found, "high")]).all()
    assert values(found)[:6] == pytest.approx(1.0 / many[0])


def test_a_ratio_of_zero_makes_the_mean_zero():
    assert geometric_mean(np.array([0.0, 8.0, 8.0])) == 0.0
    assert geometric_mean(np.array([1.0, 8.0, 1.0])) == pytest.approx(2.0)
