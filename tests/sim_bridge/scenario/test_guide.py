"""The guide to scenarios: its examples load, and its tables list every field."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import BaseModel

from sim_bridge.scenario import parse_scenario, shipped_scenarios
from sim_bridge.scenario.files.format2 import Format2
from sim_bridge.scenario.files.loading import tables_in
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


def fields_of(table: type[BaseModel]) -> Iterator[str]:
    """Names of all fields of a table and of the tables inside it."""
    for name, field in table.model_fields.items():
        yield name
        for inner in tables_in(field.annotation):
            yield from fields_of(inner)


def test_every_field_is_in_the_guide() -> None:
    names = set(fields_of(Format2))
    assert len(names) > 60
    missing = [name for name in sorted(names) if not re.search(rf"\b{name}\b", GUIDE)]
    assert missing == []


def test_every_figure_and_every_shipped_scenario_is_in_the_guide() -> None:
    for name in (*Metrics._fields, *shipped_scenarios()):
        assert f"`{name}`" in GUIDE, name
