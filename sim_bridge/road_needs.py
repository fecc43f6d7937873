"""Can a plant drive on the road of a scenario? Checked before the drive."""

from rt_controller.contract.errors import ConfigError
from sim_bridge.plant.protocol import Plant, RoadTakingPlant
from sim_bridge.scenario import Scenario

_FIELDS = {
    "friction_left": "road.friction",
    "friction_right": "road.friction_right",
    "bank_rad": "road.bank_deg",
    "grade_rad": "road.grade_percent",
    "wind_forward_mps": "tail_wind_mps",
    "wind_left_mps": "cross_wind_mps",
}
"""names in a scenario file of the fields of `RoadAt` that act on a plant"""


def require_road(plant: Plant, scenario: Scenario) -> None:
    """Return if the plant takes everything that the road of the scenario varies.

    Raises:
        ConfigError: it does not.
    """
    takes = plant.road_inputs if isinstance(plant, RoadTakingPlant) else frozenset[str]()
    road = scenario.road
    needed = set()
    if road.uniform_friction is None:
        needed |= {"friction_left", "friction_right"}
    for field, table in (
        ("bank_rad", road.bank_rad),
        ("grade_rad", road.grade),
        ("wind_forward_mps", scenario.tail_wind_mps),
        ("wind_left_mps", scenario.cross_wind_mps),
    ):
        if table.lowest().value != 0.0 or table.highest().value != 0.0:
            needed.add(field)
    missing = [name for field, name in _FIELDS.items() if field in needed - takes]
    if missing:
        raise ConfigError(
            f"scenario {scenario.name!r}: expected a plant that takes {', '.join(missing)}, found "
            f"{plant.name}, which does not. Leave {'it' if len(missing) == 1 else 'them'} out of "
            f"the scenario (friction: one number; a map: opendrive with flat = true), or choose "
            f"another --plant."
        )
