"""Fixtures of the tests of plants."""

from pathlib import Path

import pytest


@pytest.fixture
def foreign_car(tmp_path: Path) -> Path:
    """An FMU with other units and signs than the product, its mapping beside it."""
    from made_fmus import make_foreign_car  # needs the extra [fmu]

    return make_foreign_car(tmp_path, "Foreign")
