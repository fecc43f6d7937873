"""The note about a scenario that needs more steering than the controller may command."""

import pytest

from sim_bridge.scenario import load_scenario, parse_scenario
from sim_bridge.steering_needs import steering_note


def note(radius_m: float, speed_kmh: float) -> str:
    content = {
        "format": 2, "name": "circle", "duration_s": 10.0,
        "road": {"curvature_per_m": -1.0 / radius_m}, "reference": {"speed_kmh": speed_kmh},
    }  # fmt: skip
    return steering_note(parse_scenario(content, "test")) or ""


def test_a_bend_that_needs_too_much_steering_is_named_with_radius_and_speed() -> None:
    assert "about 82 deg at the steering wheel at s = 0 m (radius 40 m, 30 km/h)" in note(
        40.0, 30.0
    )
    assert "radius 100 m, 85 km/h" in note(100.0, 85.0)  # by understeer alone


@pytest.mark.parametrize(("radius_m", "speed_kmh"), [(100.0, 40.0), (80.0, 10.0), (8.0, 7.2)])
def test_a_bend_within_the_limit_has_no_note(radius_m: float, speed_kmh: float) -> None:
    assert not note(radius_m, speed_kmh)


@pytest.mark.parametrize("name", ["lane_change_60", "sine_60", "road_course"])
def test_short_peaks_have_no_note(name: str) -> None:
    assert steering_note(load_scenario(name)) is None
