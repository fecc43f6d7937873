"""Parts of the test sets."""

import numpy as np
import pytest
from toy_predictors import made_test_set, made_trajectories

from offline.evaluation.series import make_series
from rt_controller.contract.signals import VEHICLE, Schema, Signal

COUNT = 20


def made_set(name="library", count=COUNT, **columns):
    """Trajectories at 20 m/s, straight and without pedals, but for these (count, K) columns."""
    made = made_trajectories(count)
    x, u = np.zeros_like(made.x), np.zeros_like(made.u)
    x[..., 0] = 20.0
    for column, values in columns.items():
        if column in VEHICLE.state_names:
            x[..., VEHICLE.state_names.index(column)] = values
        else:
            u[..., VEHICLE.input_names.index(column)] = values
    return made_test_set(made._replace(x=x, u=u), name=name)


def series_of(*sets):
    return {series.name: series for series in make_series(sets, VEHICLE)}


def test_sideslip_is_the_largest_of_either_side_within_the_two_seconds():
    """Ten trajectories without sideslip, ten with one instant of sideslip, to both sides."""
    vy = np.zeros((COUNT, 81))
    angles_deg = [-3.0, 3.0, 5.0, -5.0, 7.0, -7.0, 10.0, -10.0, 14.0, -14.0]
    vy[10:, 33] = 20.0 * np.tan(np.radians(angles_deg))
    slices = series_of(made_set(vy_mps=vy))["sideslip"].slices
    assert [(part.label, int(part.rows.sum())) for part in slices] == [
        ("0 to 2", 10), ("2 to 4", 2), ("4 to 6", 2), ("6 to 9", 2), ("9 to 16", 4),
    ]  # fmt: skip
    assert all(part.of == "library" for part in slices)


def test_braking_is_none_light_hard_and_straight():
    brake_n = np.zeros((COUNT, 80))
    brake_n[5:, 40] = 30.0
    brake_n[12:, 41] = 75.0
    found = series_of(made_set(brake_n=brake_n), made_set("braking", 7))["braking"].slices
    assert [(part.label, part.of, int(part.rows.sum())) for part in found] == [
        ("none", "library", 5),
        ("below 75 N", "library", 7),
        ("75 N and more", "library", 8),
        ("straight, 150 N", "braking", 7),
    ]


def test_first_speeds_of_the_library_are_followed_by_those_of_the_fast_set():
    first_kmh = np.append(np.linspace(20.0, 140.0, COUNT - 1), 250.0)
    library = made_set(vx_mps=first_kmh[:, None] / 3.6)
    fast = made_set("fast", 4, vx_mps=np.array([[120.0], [140.0], [160.0], [170.0]]) / 3.6)
    found = series_of(library, fast)["speed"].slices
    assert [part.label for part in found] == [
        "0 to 50", "50 to 80", "80 to 110", "110 to 145", "145 and more",
        "130 to 150", "150 to 180",
    ]  # fmt: skip
    assert sum(int(part.rows.sum()) for part in found) == COUNT + 3


def test_whole_sets_are_ordered_by_friction_mass_and_noise():
    names = ("library", "friction-0.5", "friction-1", "nominal", "mass-1.15", "noise-1", "noise-3")
    found = series_of(*(made_set(name) for name in names))
    labels = {name: [part.label for part in series.slices] for name, series in found.items()}
    assert labels["friction"] == ["1", "0.85", "0.5"]
    assert labels["mass"] == ["1", "1.15"]
    assert labels["noise"] == ["0", "1", "3"]
    assert labels["sets"] == ["library"]


def test_a_series_says_which_sets_it_is_made_of():
    speeds = np.linspace(5.0, 35.0, COUNT)[:, None]
    alone, both = made_set(vx_mps=speeds), made_set("fast", vx_mps=speeds + 30.0)
    assert series_of(alone)["speed"].on == "library, by the first speed"
    assert series_of(alone, both)["speed"].on == "library and fast, by the first speed"


def test_a_series_needs_two_slices_but_for_that_of_the_sets():
    assert set(series_of(made_set())) == {"sets"}


@pytest.mark.parametrize("signals", [("speed_mps",), ("vx_mps",)])
def test_data_of_other_signals_have_the_series_that_their_signals_allow(signals):
    states = tuple(Signal(name, "m/s") for name in signals)
    schema = Schema(states, (Signal("pedal", "1"),), (), 0.1)
    made = made_trajectories(COUNT, states=1)
    made.x[:, 0, 0] = np.linspace(2.0, 30.0, COUNT)
    found = {series.name for series in make_series([made_test_set(made)], schema)}
    assert found == ({"sets", "speed"} if "vx_mps" in signals else {"sets"})
