"""What is followed beside a path that moved sideways, or with a speed that changed at once."""

from math import exp

import pytest

from rt_controller.contract.signals import PathReference
from rt_controller.safety.path import FollowedPath

PATH = PathReference(0.1, 0.02, 1e-3, -1e-5, 20.0, 0.0)
RETURN_PER_S = 3.5


def distance_m(t_s: float, step_m: float, step_mps: float) -> float:
    """What is left of a step after this time: exp(-r t) (a + b t + c t^2)."""
    a, b = -step_m, -(RETURN_PER_S * step_m + step_mps)
    c = -RETURN_PER_S * (0.5 * RETURN_PER_S * step_m + step_mps)
    return exp(-RETURN_PER_S * t_s) * (a + b * t_s + c * t_s**2)


def rate_mps(t_s: float, step_m: float, step_mps: float) -> float:
    h = 1e-5
    ahead, behind = (distance_m(t_s + d, step_m, step_mps) for d in (h, -h))
    return (ahead - behind) / (2.0 * h)


@pytest.mark.parametrize(("step_m", "step_mps"), [(0.4, 0.0), (-0.3, 0.5), (0.0, -0.8)])
@pytest.mark.parametrize(("speed_mps", "assumed_mps"), [(20.0, 20.0), (2.0, 5.0)])
@pytest.mark.parametrize("after_s", [0.0, 0.3])
def test_the_cubic_fits_the_distance_that_is_left_over_half_a_second(
    step_m: float, step_mps: float, speed_mps: float, assumed_mps: float, after_s: float
) -> None:
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


def test_the_acceleration_towards_another_speed_grows_by_six_in_a_second() -> None:
    followed = FollowedPath()
    followed.follow(PATH, 20.0, 1)
    for wanted_mps, sign in ((26.0, 1.0), (14.0, -1.0)):
        followed.begin()
        followed.follow(PATH, 20.0, 1)
        wanted = PATH._replace(v_mps=wanted_mps)
        rates = [followed.follow(wanted, 20.0, 1).a_mps2 for _ in range(3)]
        assert rates == pytest.approx([sign * 0.15, sign * 0.30, sign * 0.45])
        skipped = followed.follow(wanted, 20.0, 3).a_mps2
        assert skipped == pytest.approx(sign * 0.90)
