"""Residuals of a tick: their sizes, and the observers that they are compared with."""

from math import cos, inf, sin

import pytest
from made_residuals import predicted, residuals, steady

from rt_controller.contract.signals import VehicleState
from rt_controller.safety.checks import Quantity
from rt_controller.safety.isolation import Faulty
from rt_controller.safety.motion import Residuals

CRUISING = VehicleState(20.0, 0.0, 0.0, 0.5, 0.0, 0.0)
TURNING = VehicleState(20.0, 0.4, 0.2, 0.5, 0.3, 0.05)
Q = Quantity


@pytest.mark.parametrize("periods", [1, 2])
def test_the_observers_integrate_heading_and_lateral_error(periods: int) -> None:
    found, _ = residuals(begin=TURNING)
    now = TURNING._replace(epsi_rad=0.07, ey_m=0.4)
    assert found.advance(TURNING, now, 0.004, periods, Faulty.NONE) == now
    turned = periods * (0.025 * 0.2 - 0.004 * 0.5)
    sideways = 0.025 * periods
    mean = 0.05 + 0.5 * turned
    assert found.observed.epsi_rad == pytest.approx(0.05 + turned)
    assert found.observed.ey_m == pytest.approx(
        0.3 + sideways * (20.0 * sin(0.06) + 0.4 * cos(0.06))
    )
    assert found.observed.ey_by_yaw_rate_m == pytest.approx(
        0.3 + sideways * (20.0 * sin(mean) + 0.4 * cos(mean))
    )


def test_a_faulty_place_is_the_integrated_one() -> None:
    found, _ = residuals(begin=TURNING)
    now = TURNING._replace(epsi_rad=0.5, ey_m=9.0)
    state = found.advance(TURNING, now, 0.0, 1, Faulty.PLACE)
    assert state.epsi_rad == pytest.approx(0.055)
    assert state.ey_m == pytest.approx(0.3 + 0.025 * (20.0 * sin(0.0525) + 0.4 * cos(0.0525)))
    assert state[:4] == now[:4]
    assert found.observed[:2] == pytest.approx((state.ey_m, state.epsi_rad))


@pytest.mark.parametrize(
    ("faulty", "shares"),
    [
        (Faulty.NONE, (1.0, 1.0, 1.0)),
        (Faulty.HEADING, (1.0, 0.0, 1.0)),
        (Faulty.LATERAL_ERROR, (0.0, 1.0, 0.0)),
    ],
)
def test_the_observers_follow_what_is_not_faulty_within_two_seconds(
    faulty: int, shares: tuple[float, ...]
) -> None:
    found, _ = residuals()
    state = CRUISING._replace(ey_m=0.8, epsi_rad=0.8)
    found.follow(state, faulty)
    follow = 0.8 * 0.025 / 2.0
    assert found.observed == pytest.approx([share * follow for share in shares])
    found.follow(state, faulty)
    twice = follow + (0.8 - follow) * 0.0125
    assert found.observed == pytest.approx([share * twice for share in shares])


@pytest.mark.parametrize("periods", [1, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_residuals_are_sizes_per_period(side: float, periods: int) -> None:
    found, values = residuals()
    now = CRUISING._replace(vx_mps=20.0 + side * 0.2, ey_m=side * 0.1, epsi_rad=side * 0.01)
    now = now._replace(ds_m=0.025 * (20.0 + side * 0.1) * cos(0.01) + side * 0.03)
    found.compare(CRUISING, now, now, 0.0, periods)
    share = 1.0 / periods
    assert values[Q.PROGRESS_STEP_M] == pytest.approx(0.03 * share)
    assert values[Q.PROGRESS_SPEED_MPS] == pytest.approx(0.1 * 0.03 / 0.025)
    assert values[Q.HEADING_RAD] == pytest.approx(0.01 * share)
    assert values[Q.LATERAL_ERROR_M] == pytest.approx(0.1 * share)
    assert values[Q.SPEED_STEP_MPS] == pytest.approx(0.2 * share)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_slip_is_a_low_pass_of_at_most_2_m_per_s_per_tick(side: float) -> None:
    found, values = residuals()
    slips = []
    for slip_m in (0.02, 0.02, 1.0):
        found.compare(CRUISING, CRUISING._replace(ds_m=0.5 + side * slip_m), CRUISING, 0.0, 1)
        slips.append(values[Q.PROGRESS_SPEED_MPS])
    expected = [0.08, 0.08 * 0.9 + 0.08]
    assert slips == pytest.approx([*expected, expected[1] * 0.9 + 0.2])
    found.clear_speed_difference()
    found.compare(CRUISING, CRUISING._replace(ds_m=0.52), CRUISING, 0.0, 1)
    assert values[Q.PROGRESS_SPEED_MPS] == pytest.approx(0.08)
    found.begin(CRUISING)
    found.compare(CRUISING, CRUISING._replace(ds_m=0.52), CRUISING, 0.0, 1)
    assert values[Q.PROGRESS_SPEED_MPS] == pytest.approx(0.08)


@pytest.mark.parametrize("periods", [1, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_one_and_ten_steps_are_compared_with_the_model(side: float, periods: int) -> None:
    found, values = residuals(predicted((20.0, 0.02, 0.01), *[(21.0, 0.1, 0.02)] * 9))
    now = CRUISING._replace(
        vx_mps=21.0 + side * 2.0, vy_mps=0.1 + side * 0.3, yaw_rate_radps=0.02 + side * 0.1
    )
    found.compare(CRUISING, now, now, 0.0, periods)
    share = 1.0 / periods
    assert values[Q.SPEED_STEP_MPS] == pytest.approx(2.0 * share)
    assert values[Q.LATERAL_SPEED_STEP_MPS] == pytest.approx(0.3 * share)
    assert values[Q.YAW_RATE_STEP_RADPS] == pytest.approx(0.1 * share)
    assert values[Q.SPEED_TEN_MPS] == pytest.approx(abs(1.0 + side * 2.0))
    assert values[Q.LATERAL_SPEED_TEN_MPS] == pytest.approx(abs(0.08 + side * 0.3))
    assert values[Q.YAW_RATE_TEN_RADPS] == pytest.approx(abs(0.01 + side * 0.1))


def test_without_ten_steps_one_step_is_compared() -> None:
    found, values = residuals(predicted((21.0, 0.1, 0.02)))
    found.compare(CRUISING, CRUISING, CRUISING, 0.0, 1)
    assert values[Q.SPEED_STEP_MPS] == pytest.approx(1.0)
    assert values[Q.SPEED_TEN_MPS] == 0.0


@pytest.mark.parametrize(
    ("before", "now", "is_jump"),
    [(0.0, 0.1, True), (0.06, 0.1, False), (0.05, 0.1, False), (0.04, 0.1, True), (0.1, 0.0, True)],
)
def test_a_residual_of_which_more_than_half_is_new_is_a_jump(
    before: float, now: float, is_jump: bool
) -> None:
    found, _ = residuals()
    for value in (before, now):
        state = CRUISING._replace(ey_m=value, epsi_rad=value)
        found.compare(CRUISING, state, state, 0.0, 1)
    evidence = found.evidence(CRUISING, CRUISING, 0.0)
    assert (evidence.is_heading_jump, evidence.is_lateral_jump) == (is_jump, is_jump)
    found.begin(CRUISING)
    found.compare(CRUISING, state, state, 0.0, 1)
    evidence = found.evidence(CRUISING, CRUISING, 0.0)
    assert (evidence.is_heading_jump, evidence.is_lateral_jump) == (now > 0.0, now > 0.0)


@pytest.mark.parametrize(("share", "is_jump"), [(1.0, False), (1.01, True)])
def test_above_its_limit_a_residual_that_was_a_jump_remains_one(
    share: float, is_jump: bool
) -> None:
    limits = [inf] * len(Quantity)
    limits[Q.HEADING_RAD], limits[Q.LATERAL_ERROR_M] = 0.1, 0.2
    found = Residuals([0.0] * len(Quantity), None, limits)
    found.begin(CRUISING)
    for each in (share, 1.2 * share):  # less than half of it is new in the second tick
        state = CRUISING._replace(epsi_rad=0.1 * each, ey_m=0.2 * each)
        found.compare(CRUISING, state, state, 0.0, 1)
    evidence = found.evidence(CRUISING, CRUISING, 0.0)
    assert (evidence.is_heading_jump, evidence.is_lateral_jump) == (is_jump, is_jump)


@pytest.mark.parametrize(
    ("faulty", "ey_m"),
    [
        (Faulty.NONE, 0.0),
        (Faulty.LATERAL_SPEED, 0.8),
        (Faulty.LATERAL_ERROR, 0.0),
        (Faulty.LATERAL_SPEED | Faulty.LATERAL_ERROR, 0.0),
    ],
)
def test_only_after_a_fault_of_v_y_alone_the_observers_go_on_from_the_measured_e_y(
    faulty: int, ey_m: float
) -> None:
    found, _ = residuals()
    found.correct(CRUISING._replace(ey_m=0.8, epsi_rad=0.8), faulty)
    assert found.observed == (ey_m, 0.0, ey_m)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_speed_and_progress_are_compared_with_the_speed_that_is_expected(side: float) -> None:
    now = CRUISING._replace(vx_mps=20.0 + side, ds_m=0.5 + side * 0.05)
    before = CRUISING._replace(vx_mps=20.5)
    for prediction, expected_mps in (
        (None, 20.5),
        (steady(), 20.5),
        (predicted((22.0, 0.0, 0.0)), 22.0),
        (predicted((23.0, 0.0, 0.0), *[(22.0, 0.0, 0.0)] * 9), 23.0),
    ):
        found, _ = residuals(prediction)
        evidence = found.evidence(before, now, 0.25)
        assert evidence.speed_error_mps == pytest.approx(abs(now.vx_mps - expected_mps))
        assert evidence.progress_error_mps == pytest.approx(abs(now.ds_m / 0.025 - expected_mps))
        assert evidence.curvature_error_per_m == 0.25


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_lateral_error_is_explained_by_heading_or_yaw_rate(side: float) -> None:
    found, _ = residuals()
    found.observed = found.observed._replace(ey_m=0.5, ey_by_yaw_rate_m=0.7)
    evidence = found.evidence(CRUISING, CRUISING._replace(ey_m=side), 0.0)
    assert evidence.lateral_by_heading_m == pytest.approx(abs(side - 0.5))
    assert evidence.lateral_by_yaw_rate_m == pytest.approx(abs(side - 0.7))


@pytest.mark.parametrize(
    ("vy_step", "vy_ten", "yaw_step", "yaw_ten", "is_contradicted"),
    [
        (0.14, 0.28, 0.02, 0.06, False),
        (0.141, 0.0, 0.0201, 0.0, True),
        (0.0, 0.281, 0.0, 0.0601, True),
    ],
)
def test_a_prediction_of_one_or_of_ten_steps_contradicts_a_signal(
    vy_step: float, vy_ten: float, yaw_step: float, yaw_ten: float, is_contradicted: bool
) -> None:
    found, values = residuals()
    values[Q.LATERAL_SPEED_STEP_MPS], values[Q.LATERAL_SPEED_TEN_MPS] = vy_step, vy_ten
    values[Q.YAW_RATE_STEP_RADPS], values[Q.YAW_RATE_TEN_RADPS] = yaw_step, yaw_ten
    evidence = found.evidence(CRUISING, CRUISING, 0.0)
    assert evidence.contradicts_lateral_speed is is_contradicted
    assert evidence.contradicts_yaw_rate is is_contradicted
