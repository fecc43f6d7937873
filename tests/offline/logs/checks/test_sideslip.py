"""The sideslip of a drive gives the rear axle and the time scale."""

import numpy as np
import pytest
from made_logs import make_drive, make_sliding_drive

from offline.logs.checks.sideslip import fit_rear_axle

DT_S = 0.025
REACH = 4


def fit(made, dt_s=DT_S, **factors):
    speed, side, turn = (
        [factors.get(name, 1.0) * getattr(made, name)] for name in ("speed", "side", "turn")
    )
    return fit_rear_axle(speed, side, turn, dt_s, REACH)


@pytest.fixture(scope="module")
def drive():
    return make_sliding_drive(dt_s=DT_S)


def test_axle_and_stiffness_of_a_linear_car_are_found(drive):
    found = fit(drive)
    assert found.distance_m == pytest.approx(1.4, abs=0.15)
    assert found.stiffness_mps2 == pytest.approx(120.0, rel=0.1)
    assert found.time_scale == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("factor", [0.5, 2.0, 10.0])
def test_a_wrong_period_is_the_time_scale(drive, factor):
    found = fit(drive, factor * DT_S)
    assert found.time_scale == pytest.approx(factor, rel=0.1)
    low, high = found.time_scale_range
    assert low <= found.time_scale <= high


def test_noise_of_the_sensors_does_not_hide_it(drive):
    rng = np.random.default_rng(0)
    noisy = drive._replace(
        side=drive.side + rng.normal(0.0, 0.02, len(drive.time)),
        turn=drive.turn + rng.normal(0.0, 0.003, len(drive.time)),
    )
    assert fit(noisy).time_scale == pytest.approx(1.0, abs=0.15)


def test_a_lateral_speed_that_is_not_that_of_tyres_gives_nothing():
    assert fit(make_drive(120.0, DT_S)) is None
    rng = np.random.default_rng(0)
    drive = make_sliding_drive(dt_s=DT_S)
    assert fit(drive._replace(side=rng.normal(0.0, 0.3, len(drive.time)))) is None


def test_a_short_drive_gives_nothing():
    assert fit(make_sliding_drive(30.0, DT_S)) is None
