"""Drives of the made car, and mappings parsed from text."""

import pytest
from made_logs import MAPPING, Made, make_drive

from offline.logs.mapping import LogMapping, read_mapping


@pytest.fixture(scope="session")
def made_drive() -> Made:
    return make_drive()


@pytest.fixture
def parse(tmp_path):
    """Function that reads a mapping from its text."""

    def parse(text: str = MAPPING) -> LogMapping:
        path = tmp_path / "mapping.toml"
        path.write_text(text)
        return read_mapping(path)[0]

    return parse
