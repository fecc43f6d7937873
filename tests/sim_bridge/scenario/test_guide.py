"""The guide to scenarios: its examples load, and its tables list every field."""

import re
import tomllib
from pathlib import Path

import pytest

from sim_bridge.scenario import parse_scenario, shipped_scenarios
from sim_bridge.scenario.loading import field_names
from sim_bridge.scenario.metrics import Metrics

DOCS = Path(__file__).parents[3] / "docs"
GUIDE = "".join(
    (DOCS / page).read_text(encoding="utf-8")
    for page in ("scenarios.md", "reference/scenario-fields.md")
)
EXAMPLES = [
    block
    for block in re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL)
    if "without test" not in block
]


@pytest.mark.parametrize("text", EXAMPLES, ids=lambda text: tomllib.loads(text)["name"])
def test_every_example_of_the_guide_loads(text: str) -> None:
    assert parse_scenario(tomllib.loads(text), "guide").ticks > 0


def test_every_field_is_in_the_guide() -> None:
    names = set().union(*field_names())
    assert len(names) > 60
    assert [name for name in sorted(names) if not re.search(rf"\b{name}\b", GUIDE)] == []


def test_every_figure_and_every_shipped_scenario_is_in_the_guide() -> None:
    for name in (*Metrics._fields, *shipped_scenarios()):
        assert f"`{name}`" in GUIDE, name
