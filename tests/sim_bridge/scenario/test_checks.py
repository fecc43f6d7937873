"""Drives that the road cannot carry are refused where they are asked for, and only there."""

from typing import Any

import numpy as np
import pytest

from rt_controller.contract.errors import ConfigError
from sim_bridge.scenario import Scenario, parse_scenario
from sim_bridge.scenario.nominal_drive import drive_nominally

GOOD: dict[str, Any] = {
    "format": 2, "name": "good", "duration_s": 30.0, "reference": {"speed_kmh": 60.0},
}  # fmt: skip
ICE_LATER = {"friction": {"s_m": [0.0, 120.0], "value": [0.9, 0.1], "interpolation": "step"}}
BRAKING = {"speed_kmh": {"t_s": [0.0, 1.0, 3.0], "value": [60.0, 60.0, 30.0]}}
TIME_SINE = {"kind": "sine", "amplitude_m": 0.5, "frequency_hz": 0.4}


def scenario(**parts: Any) -> Scenario:
    return parse_scenario(GOOD | parts, "test")


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"road": {"friction": 0.1}, "stops": [{"at_s_m": 160.0, "deceleration_mps2": 3.0}]},
         "stops.deceleration_mps2: expected an acceleration below the grip of 1.0"),
        ({"road": {"friction": 0.1}, "stops": [{"at_s_m": 60.0, "deceleration_mps2": 0.9}]},
         "stops: expected at least the braking distance of 154.3 m"),
        ({"road": {"friction": 0.3}, "stops": [{"at_s_m": 40.0, "deceleration_mps2": 12.0}]},
         "stops: expected at least the braking distance of 47.2 m"),
        ({"road": {"friction": 0.15}, "initial": {"speed_kmh": 0.0},
          "stops": [{"at_s_m": 80.0, "deceleration_mps2": 1.0}]},
         "stops.acceleration_mps2: expected an acceleration below the grip of 1.5"),
        ({"road": {"grade_percent": 20.0, "friction": 0.1}},
         "acceleration below the grip of 1.0 m/s^2, found 0.0 m/s^2 on a slope of +20.0 %"),
        ({"road": {"grade_percent": -10.0, "friction": 0.25}, "stops": [{"at_s_m": 200.0}]},
         "stops.deceleration_mps2: expected an acceleration below the grip of 2.5 m/s^2, found "
         "-2.5 m/s^2 on a slope of -10.0 %"),
        ({"road": {"bank_deg": 12.0, "friction": 0.2}}, "2.0 m/s^2, found 2.0 m/s^2"),
        ({"road": {"friction": {"s_m": [0.0, 30.0], "value": [0.9, 0.1], "interpolation": "step"}},
          "reference": BRAKING}, "reference.speed_kmh: expected an acceleration below the grip"),
        ({"stops": [{"at_s_m": 200.0, "hold_s": 1.0}, {"at_s_m": 10.0, "hold_s": 1.0}]},
         "stops: expected at least the braking distance of 55.6 m"),
        ({"stops": [{"at_s_m": 80.0}, {"at_s_m": 80.0}]},
         "stops: expected stops 1 m apart"),
        ({"reference": {"speed_kmh": {
            "kind": "stop_and_go", "cruise_kmh": 60.0, "first_stop_s_m": 20.0, "spacing_m": 80.0,
            "count": 2}}, "stops": [{"at_s_m": 300.0}]},
         "stops: expected at least the braking distance of 55.6 m"),
        ({"initial": {"speed_kmh": 0.0}, "reference": {"speed_kmh": 60.0, "ey_m": TIME_SINE}},
         "reference.ey_m: expected a path whose cubic over the next 1.1 s or 4 m fits the frames"),
        ({"initial": {"speed_kmh": 200.0}, "road": {"curvature_per_m": 0.01}},
         "reference.speed_kmh: expected a lateral acceleration below the grip of 8.3 m/s^2, "
         "found 30.9 m/s^2 at 200 km/h, s = 0.0 m, the bank included. The radius there is 100 m, "
         "on which less than 104 km/h is possible. Lower reference.speed_kmh, or choose a wider "
         "bend in road.curvature_per_m."),
        ({"road": {"curvature_per_m": -0.02, "bank_deg": 5.0}, "reference": {"speed_kmh": 80.0}},
         "less than 77 km/h is possible"),
        ({"stops": [{"at_s_m": 100.0}, {"at_s_m": 200.0}]},
         "found one at 200 m after that at 100 m with hold_s = inf"),
        ({"stops": [{"at_s_m": 100.0, "hold_s": 1.0}, {"at_s_m": 100.4}]},
         "expected stops 1 m apart or more, each but the last with a hold_s, found one at 100.4 m"),
        ({"duration_s": 3600.0, "reference": {"speed_kmh": 50.0, "ey_m": {
            "kind": "moves", "moves": [{"start_m": 30_000.0, "length_m": 20.0, "to_m": 5.0}]}}},
         "reference.ey_m: expected a lateral acceleration below the grip of 8.3 m/s^2"),
    ],
)  # fmt: skip
def test_what_the_road_cannot_carry_is_refused_by_its_field(
    parts: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        scenario(**parts)
    assert message in str(refused.value)


def test_what_the_road_can_carry_is_not_refused_for_another_place() -> None:
    scenario(road=ICE_LATER, reference=BRAKING, duration_s=10.0)
    scenario(road=ICE_LATER, stops=[{"at_s_m": 100.0, "deceleration_mps2": 6.0}])
    scenario(road={"curvature_per_m": 0.02, "bank_deg": -8.0, "friction": 0.5})
    scenario(road={"grade_percent": 10.0, "friction": 0.25}, stops=[{"at_s_m": 200.0}])


def test_the_nominal_drive_begins_with_the_initial_speed_and_approaches_the_wanted_one() -> None:
    for first_kmh in (20.0, 90.0):
        driven = drive_nominally(scenario(initial={"speed_kmh": first_kmh})).motion.speed_mps
        assert driven[0] == pytest.approx(first_kmh / 3.6)
        assert np.abs(np.diff(driven)).max() == pytest.approx(0.05)
        assert driven[-1] == pytest.approx(60.0 / 3.6)


def test_the_nominal_drive_stops_with_the_deceleration_of_the_stop() -> None:
    motion = drive_nominally(scenario(stops=[{"at_s_m": 100.0, "hold_s": 2.0}])).motion
    assert motion.acceleration_mps2.min() == pytest.approx(-2.5)
    assert motion.acceleration_mps2.max() == pytest.approx(2.0)
    assert set(motion.is_for_stop) == {0.0, 1.0}


def test_a_long_drive_is_looked_at_as_closely_as_a_short_one() -> None:
    drive = drive_nominally(scenario(duration_s=3600.0))
    assert np.diff(drive.s_m).max() <= 0.25
