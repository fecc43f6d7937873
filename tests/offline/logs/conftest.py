"""Drives of the made car, and mappings from text."""

import pytest
from made_logs import MAPPING, Made, make_drive, rounded

from offline.logs.mapping import Mapping
from offline.logs.mapping_file import read_mapping


@pytest.fixture(scope="session")
def made_drive() -> Made:
    return make_drive()


@pytest.fixture
def columns(made_drive) -> dict[str, list]:
    """The drive as a log that a test may spoil, 10 ms a row."""
    return rounded(made_drive)


@pytest.fixture
def parse(tmp_path):
    """Reads a mapping from its text."""

    def parse(text: str = MAPPING) -> Mapping:
        path = tmp_path / "mapping.toml"
        path.write_text(text)
        return read_mapping(path)[0]

    return parse
