"""The path: compared with those before it, followed, and continued from where the car is."""

from math import e, exp, isnan

import pytest

from rt_controller.contract.limits import FAR, NEAR
from rt_controller.contract.quantities import Quantity
from rt_controller.contract.signals import CurvaturePreview, PathReference, VehicleState
from rt_controller.safety.checks import NOT_COMPUTED
from rt_controller.safety.path import (
    FollowedPath,
    LastPath,
    PathChecks,
    known_length_m,
    lateral_demand,
)

STRAIGHT = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)


def path_checks():
    """Checks of the path, and their values by `Quantity`."""
    values = [0.0] * len(Quantity)
    return PathChecks(values), values


ROAD = CurvaturePreview(4.0, 0.0, 0.001, 0.002, 0.003, 0.004)


def test_the_demand_of_a_bend_is_that_of_road_and_path_together():
    bent = STRAIGHT._replace(c2_per_m=0.002)
    assert lateral_demand(bent, 0.003, None, 20.0) == pytest.approx(2.8)
    assert lateral_demand(STRAIGHT, 0.0, ROAD, 20.0) == pytest.approx(
        400.0 * 0.001 * FAR * 10.0 / 4.0
    )


def test_a_bend_that_grows_along_the_path_counts_where_it_is_largest():
    growing = STRAIGHT._replace(c3_per_m2=1e-4)
    assert lateral_demand(growing, 0.0, None, 20.0) == pytest.approx(6e-4 * FAR * 10.0 * 400.0)
    assert lateral_demand(growing, 0.0, None, -1.0) == 0.0


def test_a_path_that_was_compared_before_is_not_compared_again():
    checks, values = path_checks()
    checks.move(1.0, 20.0)
    checks.compare(STRAIGHT, 0.0, None, 20.0)
    checks.accept(STRAIGHT, 20.0)
    checks.accept(STRAIGHT, 20.0)
    jumped = STRAIGHT._replace(c0_m=1.0)
    checks.compare(jumped, 0.0, None, 20.0)
    assert values[Quantity.PATH_STEP_M] == 1.0
    values[Quantity.PATH_STEP_M] = 0.0
    checks.compare(STRAIGHT, 0.0, None, 20.0)
    assert values[Quantity.PATH_STEP_M] == 0.0


def test_a_jump_that_is_rejected_does_not_move_the_last_path():
    checks, _ = path_checks()
    checks.reject()
    assert checks.last is None
    checks.accept(STRAIGHT, 20.0)
    checks.compare(STRAIGHT._replace(c0_m=5.0), 0.0, None, 20.0)
    checks.reject()
    assert checks.last.path_here().c0_m == 0.0


def test_after_a_drift_the_path_of_250_ms_before_is_followed():
    checks, _ = path_checks()
    sloped = STRAIGHT._replace(c1=0.06)
    for k in range(18):  # from the ninth on it is frozen
        checks.move(0.5, 20.0)
        path = sloped._replace(c0_m=0.06 * 0.5 * min(k, 8))
        checks.compare(path, 0.0, None, 20.0)
        checks.accept(path, 20.0)
    checks.reject()
    assert checks.last.path_here().c0_m == pytest.approx(17 * 0.06 * 0.5, rel=0.02)
    checks.move(0.5, 20.0)
    assert checks.last.path_here().c0_m == pytest.approx(18 * 0.06 * 0.5, rel=0.02)


def test_a_path_turns_against_the_path_before():
    checks, values = path_checks()
    checks.compare(STRAIGHT, 0.0, None, 20.0)
    assert values[Quantity.PATH_TURN_RAD] == 0.0
    checks.accept(STRAIGHT, 20.0)
    checks.move(1.0, 20.0)
    checks.compare(STRAIGHT._replace(c1=0.1), 0.0, None, 20.0)
    assert values[Quantity.PATH_TURN_RAD] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("near_per_m", "far_per_m", "largest_per_m"),
    [
        (0.01, 0.0, 0.01 + 0.0004 + 6e-5 * NEAR * 10.0),
        (0.0, 0.01, 0.01 + 0.0004 + 6e-5 * FAR * 10.0),
        (0.0, -0.01, 0.01 - 0.0004 - 6e-5 * FAR * 10.0),
    ],
)
def test_the_demand_is_the_larger_one_of_two_places_ahead(near_per_m, far_per_m, largest_per_m):
    path = STRAIGHT._replace(c2_per_m=0.0002, c3_per_m2=1e-5)
    road = CurvaturePreview(NEAR * 10.0, 0.02, near_per_m, 0.02, far_per_m, far_per_m)
    assert lateral_demand(path, 0.02, road, 20.0) == pytest.approx(400.0 * largest_per_m)


def followed(checks, values, c0_m):
    """Drift after each of these paths, of a car that does not move."""
    found = []
    for each in c0_m:
        path = STRAIGHT._replace(c0_m=each)
        checks.compare(path, 0.0, None, 20.0)
        checks.accept(path, 20.0)
        found.append(values[Quantity.PATH_DRIFT_M])
    return found


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_drift_sums_up_steps_and_loses_them_within_two_seconds(side):
    left = 1.0 - 0.025 / 2.0
    expected = [0.0, 0.1, 0.1 * (1.0 + left), 0.1 * (1.0 + left + left**2)]
    found = followed(*path_checks(), [side * each for each in (0.0, 0.1, 0.2, 0.3, 0.3)])
    assert found == pytest.approx([*expected, expected[-1] * left])
    most = followed(*path_checks(), [0.0, side * 3.0])
    assert most == pytest.approx([0.0, 0.12])  # of one step


def test_the_first_path_is_compared_with_none_and_only_its_demand_is_computed():
    values = [NOT_COMPUTED] * len(Quantity)
    PathChecks(values).compare(STRAIGHT, 0.0, None, 20.0)
    computed = [Quantity(i) for i, value in enumerate(values) if not isnan(value)]
    assert computed == [Quantity.PATH_LATERAL_MPS2]


def test_a_new_drive_has_no_drift():
    checks, values = path_checks()
    followed(checks, values, [0.0, 0.1])
    checks.begin()
    assert checks.last is None
    values[Quantity.PATH_DRIFT_M] = 0.0  # as the supervisor does in each tick
    assert followed(checks, values, [0.1]) == [0.0]
    checks.compare(STRAIGHT, 0.0, None, 20.0)
    assert values[Quantity.PATH_DRIFT_M] == pytest.approx(0.1)


def test_a_rejected_step_leaves_no_drift():
    checks, values = path_checks()
    followed(checks, values, [0.0])
    checks.compare(STRAIGHT._replace(c0_m=0.3), 0.0, None, 20.0)
    checks.reject()
    assert followed(checks, values, [0.0]) == [0.0]


def test_the_oldest_of_ten_paths_is_followed_after_a_drift_without_what_it_had_drifted():
    checks, values = path_checks()
    drifts = followed(checks, values, [0.05 * k for k in range(12)])
    checks.reject()
    assert checks.last.path_here().c0_m == pytest.approx(0.05 * 2 - drifts[2])
    checks.reject()
    assert checks.last.path_here().c0_m == pytest.approx(0.05 * 2 - drifts[2])
    assert followed(checks, values, [checks.last.path_here().c0_m]) == pytest.approx([0.0])


@pytest.mark.parametrize(("v_mps", "step_mps"), [(23.0, 3.0), (100.0, 80.0), (0.0, 0.0)])
def test_a_wanted_speed_steps_upwards(v_mps, step_mps):
    checks, values = path_checks()
    checks.accept(STRAIGHT, 20.0)
    checks.compare(STRAIGHT._replace(v_mps=v_mps), 0.0, None, 20.0)
    assert values[Quantity.PATH_SPEED_STEP_MPS] == step_mps


@pytest.mark.parametrize("step_m", [0.1, 0.5])
def test_after_one_step_the_newest_path_is_followed(step_m):
    checks, _ = path_checks()
    for v_mps in (20.0, 21.0):
        path = STRAIGHT._replace(v_mps=v_mps)
        checks.compare(path, 0.0, None, 20.0)
        checks.accept(path, 20.0)
    checks.compare(STRAIGHT._replace(c0_m=step_m), 0.0, None, 20.0)
    checks.reject()
    assert checks.last.path.v_mps == 21.0


@pytest.mark.parametrize(
    ("path", "expected_m"),
    [
        (STRAIGHT._replace(c0_m=3.5), 0.0),
        (STRAIGHT._replace(c1=0.02), 0.04),
        (STRAIGHT._replace(c2_per_m=0.001), 0.004 + 0.04),
        (STRAIGHT._replace(c3_per_m2=-1e-3), 0.008 + 0.12),
        (PathReference(0.0, 0.02, 1e-3, 5e-4, 20.0, 0.0), 0.048 + 0.1),
    ],
)
def test_a_path_that_repeats_itself_should_have_changed_with_the_way(path, expected_m):
    checks, values = path_checks()
    checks.move(5.0, 20.0)
    for _ in range(3):
        checks.compare(path._replace(), 0.0, None, 20.0)
        checks.accept(path._replace(), 20.0)
        checks.move(1.0, 20.0)
    assert values[Quantity.PATH_FROZEN_M] == pytest.approx(expected_m)
    for c0_m in (-9.0, 9.0):
        checks.compare(path._replace(c0_m=c0_m), 0.0, None, 20.0)
        assert values[Quantity.PATH_FROZEN_M] == 0.0


PATH = PathReference(0.1, 0.02, 1e-3, -1e-5, 20.0, 0.0)
RETURN_PER_S = 3.5


def distance_m(t_s, step_m, step_mps):
    """What is left of a step after this time: exp(-r t) (a + b t + c t^2)."""
    a, b = -step_m, -(RETURN_PER_S * step_m + step_mps)
    c = -RETURN_PER_S * (0.5 * RETURN_PER_S * step_m + step_mps)
    return exp(-RETURN_PER_S * t_s) * (a + b * t_s + c * t_s**2)


def rate_mps(t_s, step_m, step_mps):
    h = 1e-5
    ahead, behind = (distance_m(t_s + d, step_m, step_mps) for d in (h, -h))
    return (ahead - behind) / (2.0 * h)


@pytest.mark.parametrize(("step_m", "step_mps"), [(0.4, 0.0), (-0.3, 0.5), (0.0, -0.8)])
@pytest.mark.parametrize(("speed_mps", "assumed_mps"), [(20.0, 20.0), (2.0, 5.0)])
@pytest.mark.parametrize("after_s", [0.0, 0.3])
def test_the_cubic_fits_the_distance_that_is_left_over_half_a_second(
    step_m, step_mps, speed_mps, assumed_mps, after_s
):
    followed = FollowedPath()
    path = PATH._replace(v_mps=speed_mps)
    followed.follow(path, speed_mps, 1)
    followed.shift(step_m, step_mps)
    followed.move(after_s * assumed_mps, speed_mps)
    found = followed.follow(path, speed_mps, 1)
    c0, c1, c2, c3 = (new - old for new, old in zip(found[:4], path[:4], strict=True))
    for t_s in (0.0, 0.5):
        s_m, time_s = t_s * assumed_mps, after_s + t_s
        place, slope = c0 + s_m * (c1 + s_m * (c2 + s_m * c3)), c1 + s_m * (2 * c2 + 3 * s_m * c3)
        assert place == pytest.approx(distance_m(time_s, step_m, step_mps), abs=1e-9)
        assert slope * assumed_mps == pytest.approx(rate_mps(time_s, step_m, step_mps), abs=1e-6)


def test_the_acceleration_towards_another_speed_grows_by_six_in_a_second():
    followed = FollowedPath()
    followed.follow(PATH, 20.0, 1)
    for wanted_mps, sign in ((26.0, 1.0), (14.0, -1.0)):
        followed.begin()
        followed.follow(PATH, 20.0, 1)
        wanted = PATH._replace(v_mps=wanted_mps)
        rates = [followed.follow(wanted, 20.0, 1).a_mps2 for _ in range(3)]
        assert rates == pytest.approx([sign * 0.15, sign * 0.30, sign * 0.45])
        assert followed.follow(wanted, 20.0, 3).a_mps2 == pytest.approx(sign * 0.90)
        # The other way it begins at zero.
        back = PATH._replace(v_mps=20.0 - sign * 6.0)
        assert followed.follow(back, 20.0, 1).a_mps2 == pytest.approx(-sign * 0.15)


@pytest.mark.parametrize(
    ("wanted_mps", "car_mps", "is_driven"),
    [(20.0, v_mps, 19.0 <= v_mps <= 21.0) for v_mps in (18.9, 19.0, 19.5, 20.5, 21.0, 21.1)],
)
def test_a_drive_begins_with_a_wanted_speed_that_the_car_has_within_1_m_per_s(
    wanted_mps, car_mps, is_driven
):
    found = FollowedPath().follow(PATH._replace(v_mps=wanted_mps), car_mps, 1)
    assert found.v_mps == pytest.approx(wanted_mps if is_driven else car_mps, abs=0.01)


@pytest.mark.parametrize(
    ("before_mps", "wanted_mps", "followed_mps"),
    [
        (0.0, 2.02, 2.02),  # 2 m/s are reached with 2 m/s^2, and 0.02 m/s are no difference
        (0.0, 2.03, 2.0),
        (10.0, 6.98, 6.98),
        (10.0, 6.97, 7.0),
        (20.0, 20.5, 20.5),  # not beyond it
        (20.0, 19.5, 19.5),
    ],
)
def test_after_a_second_without_ticks_the_speed_has_changed_as_in_a_second(
    before_mps, wanted_mps, followed_mps
):
    followed = FollowedPath()
    followed.follow(PATH._replace(v_mps=before_mps), before_mps, 1)
    found = followed.follow(PATH._replace(v_mps=wanted_mps), before_mps, 40)
    assert found.v_mps == pytest.approx(followed_mps, abs=1e-12)


@pytest.mark.parametrize(("ticks_between", "is_followed"), [(0, True), (22, True), (23, False)])
def test_a_speed_may_change_with_an_acceleration_that_was_sent_in_the_last_0_6_s(
    ticks_between, is_followed
):
    followed = FollowedPath()
    for a_mps2 in (-5.0, *[0.0] * ticks_between):
        followed.follow(PATH._replace(a_mps2=a_mps2), 20.0, 1)
    changed = PATH._replace(v_mps=20.0 - 5.0 * 0.025)
    assert (followed.follow(changed, 20.0, 1) == changed) is is_followed


@pytest.mark.parametrize(("step_m", "followed_m"), [(0.1, 0.1), (0.101, 0.0), (-0.101, 0.0)])
def test_a_step_of_more_than_10_cm_is_approached_and_a_smaller_one_is_followed(step_m, followed_m):
    checks, _ = path_checks()
    for c0_m in (0.0, step_m):
        path = STRAIGHT._replace(c0_m=c0_m)
        checks.compare(path, 0.0, None, 20.0)
        checks.accept(path, 20.0)
        found = checks.follow(path, 20.0, 1)
    assert found.c0_m == pytest.approx(followed_m, abs=1e-9)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("before", "now", "periods", "step_m", "step_mps"),
    [
        ((0.2, 0.0), (0.4, 0.0), 1, 0.2, 0.0),
        ((0.2, 0.01), (0.4, 0.03), 2, 0.2 - 2 * 0.025 * 0.2, 0.4),
        ((0.2, 0.0), (2.0, 0.3), 1, 0.5, 1.0),  # at most
    ],
)
def test_an_estimate_that_replaces_the_state_moves_the_followed_path_with_it(
    side, before, now, periods, step_m, step_mps
):
    """(e_y, e_psi) at 20 m/s: the distance to the path and its change stay."""
    checks, _ = path_checks()
    checks.follow(STRAIGHT, 20.0, 1)
    states = (VehicleState(20.0, 0.0, 0.0, 0.5, side * y, side * psi) for y, psi in (before, now))
    checks.blend(*states, periods)
    found = checks.follow(STRAIGHT, 20.0, 1)
    assert found.c0_m == pytest.approx(side * step_m, abs=1e-5)
    assert found.c1 * 20.0 == pytest.approx(side * step_mps, abs=1e-3)


CURVED = PathReference(0.5, 0.05, 1e-3, -2e-5, 20.0, 0.0)


def value(path, s):
    return path.c0_m + s * (path.c1 + s * (path.c2_per_m + s * path.c3_per_m2))


def test_a_path_that_moved_along_is_the_same_curve_to_the_end_of_its_known_part():
    moved = LastPath(CURVED, 20.0).moved(3.0).moved(4.0)
    for ahead in (0.0, 2.0, 5.0):
        assert value(moved.path_here(), ahead) == pytest.approx(value(CURVED, 7.0 + ahead))
    end = LastPath(CURVED, 10.0).moved(10.0).path_here()
    assert value(end, 5.0) == pytest.approx(value(CURVED, 15.0))


def test_behind_its_known_part_a_path_eases_into_the_road():
    last = LastPath(CURVED, 10.0)
    end, behind = last.moved(10.0).path_here(), last.moved(10.0 + 1e-9).path_here()
    assert (behind.c0_m, behind.c1) == pytest.approx((end.c0_m, end.c1))
    slopes = [last.moved(10.0 + d).path_here().c1 for d in (1.0, 5.0, 20.0, 100.0)]
    assert slopes == sorted(slopes, reverse=True)
    assert slopes[-1] == pytest.approx(0.0, abs=1e-6)
    here, there = last.moved(12.0).path_here(), last.moved(12.5).path_here()
    assert value(here, 0.5) == pytest.approx(there.c0_m, abs=1e-4)


@pytest.mark.parametrize(("vx_mps", "length_m"), [(0.0, 10.0), (30.0, 15.0)])
def test_a_path_is_used_for_half_a_second(vx_mps, length_m):
    assert known_length_m(vx_mps, CURVED) == length_m
    assert known_length_m(0.0, CURVED._replace(v_mps=0.0)) == 4.0


def test_the_slope_decays_by_a_factor_e_over_six_tenths_of_the_known_part():
    gentle = LastPath(CURVED._replace(c1=0.03), 10.0)
    end, behind = gentle.moved(10.0).path_here(), gentle.moved(16.0).path_here()
    slope = end.c1 / e
    assert behind.c0_m == pytest.approx(end.c0_m + 6.0 * (end.c1 - slope))
    assert behind[1:4] == pytest.approx((slope, -slope / 12.0, slope / 216.0))
    assert behind[4:] == CURVED[4:]


@pytest.mark.parametrize("slope", [-0.08, 0.08])
def test_a_steep_path_becomes_parallel_with_4_m_per_s2(slope):
    speed_mps, known_m = 30.0, 15.0
    last = LastPath(PathReference(0.0, slope, 0.0, 0.0, speed_mps, 0.0), known_m)
    behind = last.moved(known_m + 1e-6).path_here()
    lateral_mps2 = 2.0 * behind.c2_per_m * speed_mps**2
    assert lateral_mps2 == pytest.approx(-4.0 if slope > 0.0 else 4.0, rel=1e-3)
    gentle = LastPath(PathReference(0.0, slope / 10.0, 0.0, 0.0, speed_mps, 0.0), known_m)
    assert gentle.moved(known_m + 1e-6).path_here().c2_per_m == pytest.approx(-slope / 180.0)
