"""The last known path, from where the car is now."""

from math import e

import pytest

from rt_controller.contract.signals import PathReference
from rt_controller.safety.path import LastPath, known_length_m

PATH = PathReference(0.5, 0.05, 1e-3, -2e-5, 20.0, 0.0)


def value(path: PathReference, s: float) -> float:
    return path.c0_m + s * (path.c1 + s * (path.c2_per_m + s * path.c3_per_m2))


def test_a_path_that_moved_along_is_the_same_curve() -> None:
    moved = LastPath(PATH, 20.0).moved(3.0).moved(4.0)
    for ahead in (0.0, 2.0, 5.0):
        assert value(moved.path_here(), ahead) == pytest.approx(value(PATH, 7.0 + ahead))
    assert moved.path_here().c0_m == pytest.approx(value(PATH, 7.0))


def test_behind_its_known_part_a_path_eases_into_the_road() -> None:
    last = LastPath(PATH, 10.0)
    end, behind = last.moved(10.0).path_here(), last.moved(10.0 + 1e-9).path_here()
    assert (behind.c0_m, behind.c1) == pytest.approx((end.c0_m, end.c1))
    slopes = [last.moved(10.0 + d).path_here().c1 for d in (1.0, 5.0, 20.0, 100.0)]
    assert slopes == sorted(slopes, reverse=True)
    assert slopes[-1] == pytest.approx(0.0, abs=1e-6)
    here, there = last.moved(12.0).path_here(), last.moved(12.5).path_here()
    assert value(here, 0.5) == pytest.approx(there.c0_m, abs=1e-4)


@pytest.mark.parametrize(("vx_mps", "length_m"), [(0.0, 10.0), (30.0, 15.0)])
def test_a_path_is_used_for_half_a_second(vx_mps: float, length_m: float) -> None:
    assert known_length_m(vx_mps, PATH) == length_m
    assert known_length_m(0.0, PATH._replace(v_mps=0.0)) == 4.0


def test_at_the_end_of_its_known_part_a_path_is_still_the_same_curve() -> None:
    end = LastPath(PATH, 10.0).moved(10.0).path_here()
    assert value(end, 5.0) == pytest.approx(value(PATH, 15.0))


def test_the_slope_decays_by_a_factor_e_over_six_tenths_of_the_known_part() -> None:
    gentle = LastPath(PATH._replace(c1=0.03), 10.0)
    end, behind = gentle.moved(10.0).path_here(), gentle.moved(16.0).path_here()
    slope = end.c1 / e
    assert behind.c0_m == pytest.approx(end.c0_m + 6.0 * (end.c1 - slope))
    assert behind[1:4] == pytest.approx((slope, -slope / 12.0, slope / 216.0))
    assert behind[4:] == PATH[4:]


@pytest.mark.parametrize("slope", [-0.08, 0.08])
def test_a_steep_path_becomes_parallel_with_4_m_per_s2(slope: float) -> None:
    speed_mps, known_m = 30.0, 15.0
    last = LastPath(PathReference(0.0, slope, 0.0, 0.0, speed_mps, 0.0), known_m)
    behind = last.moved(known_m + 1e-6).path_here()
    lateral_mps2 = 2.0 * behind.c2_per_m * speed_mps**2
    assert lateral_mps2 == pytest.approx(-4.0 if slope > 0.0 else 4.0, rel=1e-3)
    gentle = LastPath(PathReference(0.0, slope / 10.0, 0.0, 0.0, speed_mps, 0.0), known_m)
    assert gentle.moved(known_m + 1e-6).path_here().c2_per_m == pytest.approx(-slope / 180.0)
