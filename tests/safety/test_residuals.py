"""Residuals of the state, and the effect of the pedals."""

from math import cos, inf, sin

import pytest
from made_residuals import predicted, residuals, steady

from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import NEUTRAL_INPUT, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.coast_model import PedalEffect
from rt_controller.safety.isolation import Faulty
from rt_controller.safety.motion import Residuals, with_replaced_signals

CRUISING = VehicleState(20.0, 0.0, 0.0, 0.5, 0.0, 0.0)
TURNING = VehicleState(20.0, 0.4, 0.2, 0.5, 0.3, 0.05)
Q = Quantity


@pytest.mark.parametrize("periods", [1, 2])
def test_the_observers_integrate_heading_and_lateral_error(periods):
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


def test_a_faulty_place_is_the_integrated_one():
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
def test_the_observers_follow_what_is_not_faulty_within_two_seconds(faulty, shares):
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
def test_residuals_are_sizes_per_period(side, periods):
    found, values = residuals()
    now = CRUISING._replace(vx_mps=20.0 + side * 0.2, ey_m=side * 0.1, epsi_rad=side * 0.01)
    now = now._replace(ds_m=0.025 * (20.0 + side * 0.1) * cos(0.01) + side * 0.03)
    found.compare(CRUISING, now, now, 0.0, periods)
    quantities = (Q.PROGRESS_STEP_M, Q.HEADING_RAD, Q.LATERAL_ERROR_M, Q.SPEED_STEP_MPS)
    sizes = [periods * values[each] for each in quantities]
    assert sizes == pytest.approx([0.03, 0.01, 0.1, 0.2])
    assert values[Q.PROGRESS_SPEED_MPS] == pytest.approx(0.1 * 0.03 / 0.025)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_slip_is_a_low_pass_of_at_most_2_m_per_s_per_tick(side):
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
def test_one_and_ten_steps_are_compared_with_the_model(side, periods):
    found, values = residuals(predicted((20.0, 0.02, 0.01), *[(21.0, 0.1, 0.02)] * 9))
    now = CRUISING._replace(
        vx_mps=21.0 + side * 2.0, vy_mps=0.1 + side * 0.3, yaw_rate_radps=0.02 + side * 0.1
    )
    found.compare(CRUISING, now, now, 0.0, periods)
    one = (Q.SPEED_STEP_MPS, Q.LATERAL_SPEED_STEP_MPS, Q.YAW_RATE_STEP_RADPS)
    ten = (Q.SPEED_TEN_MPS, Q.LATERAL_SPEED_TEN_MPS, Q.YAW_RATE_TEN_RADPS)
    # A speed that has changed less than it differs from the model is no jump.
    changed = abs(1.0 + side * 2.0)
    found_one = [periods * values[each] for each in one]
    assert found_one == pytest.approx([min(2.0, changed), 0.3, 0.1])
    expected = [changed, abs(0.08 + side * 0.3), abs(0.01 + side * 0.1)]
    assert [values[each] for each in ten] == pytest.approx(expected)


def test_without_ten_steps_one_step_is_compared():
    found, values = residuals(predicted((21.0, 0.1, 0.02)))
    now = CRUISING._replace(vx_mps=22.5)
    found.compare(CRUISING, now, now, 0.0, 1)
    assert values[Q.SPEED_STEP_MPS] == pytest.approx(1.5)
    assert values[Q.SPEED_TEN_MPS] == 0.0


@pytest.mark.parametrize(
    ("before", "now", "is_jump"),
    [(0.0, 0.1, True), (0.06, 0.1, False), (0.05, 0.1, False), (0.04, 0.1, True), (0.1, 0.0, True)],
)
def test_a_residual_of_which_more_than_half_is_new_is_a_jump(before, now, is_jump):
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
def test_above_its_limit_a_residual_that_was_a_jump_remains_one(share, is_jump):
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
    ("deviations_m", "is_slow"),
    [
        ([0.1] * 47, False),
        ([0.1] * 48, False),
        ([-0.1] * 49, True),
        ([0.05] + [0.1] * 49, True),
        ([0.2] * 60, True),
        ([0.1] * 48 + [0.099] + [0.1] * 48, False),
    ],
)
def test_a_lateral_error_of_10_cm_or_more_for_1_2_s_is_slow(deviations_m, is_slow):
    found, _ = residuals()
    for each in deviations_m:
        state = CRUISING._replace(ey_m=each)
        found.compare(CRUISING, state, state, 0.0, 1)
    assert found.evidence(CRUISING, state, 0.0).is_lateral_slow is is_slow


@pytest.mark.parametrize(
    ("faulty", "ey_m"),
    [
        (Faulty.NONE, 0.0),
        (Faulty.LATERAL_SPEED, 0.8),
        (Faulty.LATERAL_ERROR, 0.0),
        (Faulty.LATERAL_SPEED | Faulty.LATERAL_ERROR, 0.0),
    ],
)
def test_only_after_a_fault_of_v_y_alone_the_observers_go_on_from_the_measured_e_y(faulty, ey_m):
    found, _ = residuals()
    found.correct(CRUISING._replace(ey_m=0.8, epsi_rad=0.8), faulty)
    assert found.observed == (ey_m, 0.0, ey_m)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_speed_and_progress_are_compared_with_the_speed_that_is_expected(side):
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
def test_the_lateral_error_is_explained_by_heading_or_yaw_rate(side):
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
    vy_step, vy_ten, yaw_step, yaw_ten, is_contradicted
):
    found, values = residuals()
    values[Q.LATERAL_SPEED_STEP_MPS], values[Q.LATERAL_SPEED_TEN_MPS] = vy_step, vy_ten
    values[Q.YAW_RATE_STEP_RADPS], values[Q.YAW_RATE_TEN_RADPS] = yaw_step, yaw_ten
    evidence = found.evidence(CRUISING, CRUISING, 0.0)
    assert evidence.contradicts_lateral_speed is is_contradicted
    assert evidence.contradicts_yaw_rate is is_contradicted


OPEN_MPS2, HILL_MPS2, LAG_S = 6.0, 2.0, 0.3
OPEN = NEUTRAL_INPUT._replace(throttle=0.5)
BRAKED = NEUTRAL_INPUT._replace(brake_n=40.0)
BOTH = NEUTRAL_INPUT._replace(throttle=0.75, brake_n=30.0)
"""accelerates as OPEN alone"""


def test_a_car_that_answers_its_pedals_misses_no_speed():
    effect, pedals_mps2, v_mps = PedalEffect(OPEN_MPS2, 0.05), 0.0, 0.0
    for _ in range(60):
        pedals_mps2 += PERIOD_S / LAG_S * (3.0 - pedals_mps2)
        before, v_mps = v_mps, v_mps + PERIOD_S * pedals_mps2
        assert effect.missing_mps(OPEN, before, v_mps, 1) == pytest.approx(0.0, abs=1e-12)


def missed(control, v_mps=0.0, mps2=0.0, effect=None):
    """Missing speed in each of 120 periods of a car with this acceleration."""
    effect, found = effect or PedalEffect(OPEN_MPS2, 0.05), []
    for _ in range(120):
        before, v_mps = v_mps, v_mps + PERIOD_S * mps2
        found.append(effect.missing_mps(control, before, v_mps, 1))
    return found


@pytest.mark.parametrize(
    ("control", "mps2"),
    [
        # another car that answers its throttle
        *((OPEN, part * (3.0 - HILL_MPS2)) for part in (0.05, 0.5, 2.0)),
        # one that the throttle holds on a hill, or the brake
        (NEUTRAL_INPUT._replace(throttle=HILL_MPS2 / OPEN_MPS2), 0.0),
        (BRAKED, 0.0),
        (NEUTRAL_INPUT, -1.0),  # one that rolls out
    ],
)
def test_a_car_that_answers_its_pedals_or_is_held_misses_nothing(control, mps2):
    assert set(missed(control, mps2=mps2)) == {0.0}


def test_while_the_brake_is_being_released_nothing_is_missed():
    effect = PedalEffect(OPEN_MPS2, 0.05)
    missed(BRAKED, effect=effect)
    assert effect.missing_mps(OPEN, 0.0, 0.0, 1) == 0.0


@pytest.mark.parametrize("v_mps", [0.0, 3.0])
def test_a_speed_that_stays_while_the_throttle_is_open_is_missed_more_and_more(v_mps):
    found = missed(OPEN, v_mps)
    assert found == sorted(found)
    assert found[-1] == pytest.approx(3.0 - HILL_MPS2, rel=0.1)
    assert missed(OPEN, mps2=0.03 * (3.0 - HILL_MPS2))[-1] > 0.8  # it hardly changes


def test_the_brake_takes_away_from_the_throttle():
    assert missed(BOTH) == pytest.approx(missed(OPEN))


@pytest.mark.parametrize("throttle_mps2", [1.5, 3.0, 9.0])
def test_of_a_weaker_or_stronger_car_the_same_share_is_missing(throttle_mps2):
    effect = PedalEffect(throttle_mps2, 0.05 * throttle_mps2 / OPEN_MPS2)
    assert missed(BOTH, effect=effect)[-1] == pytest.approx(missed(OPEN)[-1])


def test_several_periods_count_once_each_and_a_new_drive_begins_with_none():
    effect = PedalEffect(OPEN_MPS2, 0.05)
    one = effect.missing_mps(OPEN, 0.0, 0.0, 20)
    assert one == pytest.approx(20 * PERIOD_S * (3.0 - HILL_MPS2))
    after_long = effect.missing_mps(OPEN, 0.0, 0.0, 60)
    assert after_long == pytest.approx(60 * PERIOD_S * (3.0 - HILL_MPS2))
    assert effect.missing_mps(NEUTRAL_INPUT, 0.0, 0.0, 60) == 0.0  # all is forgotten
    effect.missing_mps(OPEN, 0.0, 0.0, 20)
    effect.begin()
    assert effect.missing_mps(NEUTRAL_INPUT, 0.0, 0.0, 1) == 0.0


@pytest.mark.parametrize(("reached_mps", "missing_mps"), [(0.02, 0.0), (0.0199, 0.4801)])
def test_a_car_answers_with_4_percent_of_the_acceleration_beyond_the_hill(reached_mps, missing_mps):
    """0.04 m/s^2 during half a second."""
    found = PedalEffect(OPEN_MPS2, 0.05).missing_mps(OPEN, 0.0, reached_mps, 20)
    assert found == pytest.approx(missing_mps)


MEASURED = VehicleState(20.0, 0.1, 0.2, 0.4, 0.5, 0.01)
EXPECTED = VehicleState(18.0, 0.0, 0.1, 0.45, 0.6, 0.02)


@pytest.mark.parametrize(
    ("faulty", "expected"),
    [
        (Faulty.NONE, MEASURED),
        (Faulty.PLACE, MEASURED),
        (Faulty.SPEED, MEASURED._replace(vx_mps=0.4 / 0.025)),
        (Faulty.PROGRESS, MEASURED._replace(ds_m=20.0 * 0.025)),
        (Faulty.SPEED | Faulty.PROGRESS, MEASURED._replace(vx_mps=18.0, ds_m=18.0 * 0.025)),
        (Faulty.LATERAL_SPEED, MEASURED._replace(vy_mps=0.0)),
        (Faulty.YAW_RATE, MEASURED._replace(yaw_rate_radps=0.1)),
    ],
)
def test_a_faulty_signal_of_the_motion_is_replaced(faulty, expected):
    found = with_replaced_signals(MEASURED, EXPECTED, faulty)
    assert found == pytest.approx(expected)
    assert (found is MEASURED) is (faulty == Faulty.NONE)  # a usual tick makes no other state
