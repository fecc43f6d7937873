"""The note about a scenario that needs more grip than --friction gives."""

from sim_bridge.scenario import parse_scenario
from sim_bridge.scenario_checks import grip_note

BEND = parse_scenario(
    {
        "format": 2, "name": "bend", "duration_s": 10.0,
        "road": {"curvature_per_m": 0.02}, "reference": {"speed_kmh": 60.0},
    },
    "test",
)  # fmt: skip


def test_too_little_friction_is_noted_with_place_demand_and_grip() -> None:
    note = grip_note(BEND.with_friction(0.5)) or ""
    assert "scenario 'bend' with this --friction: reference.speed_kmh: expected a lateral" in note
    assert "below the grip of 4.9 m/s^2, found 5.6 m/s^2 at 60 km/h, s = 0.0 m" in note
    assert note.endswith("It is driven all the same.")


def test_enough_friction_has_no_note() -> None:
    assert grip_note(BEND.with_friction(0.6)) is None
