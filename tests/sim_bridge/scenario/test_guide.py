"""The guide to scenarios: its examples load, and its tables list every field."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import BaseModel

from sim_bridge.scenario import parse_scenario, shipped_scenarios
from sim_bridge.scenario.file import ScenarioFile
from sim_bridge.scenario.loading import fields_of
from sim_bridge.scenario.metrics import Metrics

GUIDE = (Path(__file__).parents[3] / "docs" / "scenarios.md").read_text(encoding="utf-8")
EXAMPLES = [
    block
    for block in re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL)
    if "without test" not in block
]


@pytest.mark.parametrize("text", EXAMPLES, ids=lambda text: tomllib.loads(text)["name"])
def test_every_example_of_the_guide_loads(text: str) -> None:
    assert parse_scenario(tomllib.loads(text), "guide").ticks > 0


def names_in(table: type[BaseModel]) -> Iterator[str]:
    """Names of all fields of a table and of the tables inside it."""
    for name, inner in fields_of(table).items():
        yield name
        for each in inner:
            yield from names_in(each)


def test_every_field_is_in_the_guide() -> None:
    names = set(names_in(ScenarioFile))
    assert len(names) > 60
    missing = [name for name in sorted(names) if not re.search(rf"\b{name}\b", GUIDE)]
    assert missing == []


def test_every_figure_and_every_shipped_scenario_is_in_the_guide() -> None:
    for name in (*Metrics._fields, *shipped_scenarios()):
        assert f"`{name}`" in GUIDE, name
