"""Lateral acceleration of a path, and its continuation of the paths before it."""

import pytest

from rt_controller.contract.limits import FAR, NEAR
from rt_controller.contract.signals import CurvaturePreview, PathReference
from rt_controller.safety.checks import NOT_COMPUTED, Quantity, is_computed
from rt_controller.safety.path import PathChecks, lateral_demand

STRAIGHT = PathReference(0.0, 0.0, 0.0, 0.0, 20.0, 0.0)
ROAD = CurvaturePreview(4.0, 0.0, 0.001, 0.002, 0.003, 0.004)


def test_the_demand_of_a_bend_is_that_of_road_and_path_together() -> None:
    bent = STRAIGHT._replace(c2_per_m=0.002)
    assert lateral_demand(bent, 0.003, None, 20.0) == pytest.approx(2.8)
    assert lateral_demand(STRAIGHT, 0.0, ROAD, 20.0) == pytest.approx(1.2)


def test_a_bend_that_grows_along_the_path_counts_where_it_is_largest() -> None:
    growing = STRAIGHT._replace(c3_per_m2=1e-4)
    found = lateral_demand(growing, 0.0, None, 20.0)
    assert found == pytest.approx(6e-4 * FAR * 10.0 * 400.0)
    assert lateral_demand(growing, 0.0, None, -1.0) == 0.0


def test_a_path_that_was_compared_before_is_not_compared_again() -> None:
    values = [0.0] * len(Quantity)
    checks = PathChecks(values)
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


def test_a_jump_that_is_rejected_does_not_move_the_last_path() -> None:
    checks = PathChecks([0.0] * len(Quantity))
    checks.reject()
    assert checks.last is None
    checks.accept(STRAIGHT, 20.0)
    checks.compare(STRAIGHT._replace(c0_m=5.0), 0.0, None, 20.0)
    checks.reject()
    assert checks.last is not None
    assert checks.last.path_here().c0_m == 0.0


def test_after_a_drift_the_path_of_250_ms_before_is_followed() -> None:
    checks = PathChecks([0.0] * len(Quantity))
    sloped = STRAIGHT._replace(c1=0.06)
    for k in range(18):  # from the ninth on it is frozen
        checks.move(0.5, 20.0)
        path = sloped._replace(c0_m=0.06 * 0.5 * min(k, 8))
        checks.compare(path, 0.0, None, 20.0)
        checks.accept(path, 20.0)
    checks.reject()
    assert checks.last is not None
    assert checks.last.path_here().c0_m == pytest.approx(17 * 0.06 * 0.5, rel=0.02)
    checks.move(0.5, 20.0)
    assert checks.last.path_here().c0_m == pytest.approx(18 * 0.06 * 0.5, rel=0.02)


def test_a_path_turns_against_the_path_before() -> None:
    values = [0.0] * len(Quantity)
    checks = PathChecks(values)
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
def test_the_demand_is_the_larger_one_of_two_places_ahead(
    near_per_m: float, far_per_m: float, largest_per_m: float
) -> None:
    path = STRAIGHT._replace(c2_per_m=0.0002, c3_per_m2=1e-5)
    road = CurvaturePreview(4.0, 0.02, near_per_m, 0.02, far_per_m, 0.02)
    found = lateral_demand(path, 0.02, road, 20.0)
    assert found == pytest.approx(400.0 * largest_per_m)


def followed(checks: PathChecks, values: list[float], c0_m: list[float]) -> list[float]:
    """Drift after each of these paths, of a car that does not move."""
    found = []
    for each in c0_m:
        path = STRAIGHT._replace(c0_m=each)
        checks.compare(path, 0.0, None, 20.0)
        checks.accept(path, 20.0)
        found.append(values[Quantity.PATH_DRIFT_M])
    return found


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_drift_sums_up_steps_and_loses_them_within_two_seconds(side: float) -> None:
    values = [0.0] * len(Quantity)
    checks = PathChecks(values)
    steps = [0.0, 0.1, 0.2, 0.3, 0.3]
    found = followed(checks, values, [side * each for each in steps])
    left = 1.0 - 0.025 / 2.0
    expected = [0.0, 0.1, 0.1 * (1.0 + left), 0.1 * (1.0 + left + left**2)]
    assert found == pytest.approx([*expected, expected[-1] * left])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_one_step_counts_with_12_cm_at_most_in_the_drift(side: float) -> None:
    values = [0.0] * len(Quantity)
    assert followed(PathChecks(values), values, [0.0, side * 3.0]) == pytest.approx([0.0, 0.12])


def test_the_first_path_is_compared_with_none_and_only_its_demand_is_computed() -> None:
    values = [NOT_COMPUTED] * len(Quantity)
    PathChecks(values).compare(STRAIGHT, 0.0, None, 20.0)
    computed = [Quantity(i) for i, value in enumerate(values) if is_computed(value)]
    assert computed == [Quantity.PATH_LATERAL_MPS2]


def test_a_new_drive_has_no_drift() -> None:
    values = [0.0] * len(Quantity)
    checks = PathChecks(values)
    followed(checks, values, [0.0, 0.1])
    checks.begin()
    assert checks.last is None
    values[Quantity.PATH_DRIFT_M] = 0.0  # as the supervisor does in each tick
    assert followed(checks, values, [0.1]) == [0.0]
    checks.compare(STRAIGHT, 0.0, None, 20.0)
    assert values[Quantity.PATH_DRIFT_M] == pytest.approx(0.1)


def test_a_rejected_step_leaves_no_drift() -> None:
    values = [0.0] * len(Quantity)
    checks = PathChecks(values)
    followed(checks, values, [0.0])
    checks.compare(STRAIGHT._replace(c0_m=0.3), 0.0, None, 20.0)
    checks.reject()
    assert followed(checks, values, [0.0]) == [0.0]


def test_the_oldest_of_ten_paths_is_followed_after_a_drift_without_what_it_had_drifted() -> None:
    values = [0.0] * len(Quantity)
    checks = PathChecks(values)
    drifts = followed(checks, values, [0.05 * k for k in range(12)])
    checks.reject()
    assert checks.last is not None
    assert checks.last.path_here().c0_m == pytest.approx(0.05 * 2 - drifts[2])
    checks.reject()
    assert checks.last.path_here().c0_m == pytest.approx(0.05 * 2 - drifts[2])
    assert followed(checks, values, [checks.last.path_here().c0_m]) == pytest.approx([0.0])


@pytest.mark.parametrize(("v_mps", "step_mps"), [(23.0, 3.0), (100.0, 80.0), (0.0, 0.0)])
def test_a_wanted_speed_steps_upwards(v_mps: float, step_mps: float) -> None:
    values = [0.0] * len(Quantity)
    checks = PathChecks(values)
    checks.accept(STRAIGHT, 20.0)
    checks.compare(STRAIGHT._replace(v_mps=v_mps), 0.0, None, 20.0)
    assert values[Quantity.PATH_SPEED_STEP_MPS] == step_mps


@pytest.mark.parametrize("step_m", [0.1, 0.5])
def test_after_one_step_the_newest_path_is_followed(step_m: float) -> None:
    checks = PathChecks([0.0] * len(Quantity))
    for v_mps in (20.0, 21.0):
        path = STRAIGHT._replace(v_mps=v_mps)
        checks.compare(path, 0.0, None, 20.0)
        checks.accept(path, 20.0)
    checks.compare(STRAIGHT._replace(c0_m=step_m), 0.0, None, 20.0)
    checks.reject()
    assert checks.last is not None
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
def test_a_path_that_repeats_itself_should_have_changed_with_the_way(
    path: PathReference, expected_m: float
) -> None:
    values = [0.0] * len(Quantity)
    checks = PathChecks(values)
    checks.move(5.0, 20.0)
    for _ in range(3):
        checks.compare(path._replace(), 0.0, None, 20.0)
        checks.accept(path._replace(), 20.0)
        checks.move(1.0, 20.0)
    assert values[Quantity.PATH_FROZEN_M] == pytest.approx(expected_m)
    for c0_m in (-9.0, 9.0):
        checks.compare(path._replace(c0_m=c0_m), 0.0, None, 20.0)
        assert values[Quantity.PATH_FROZEN_M] == 0.0
