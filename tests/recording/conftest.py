"""A short recorded drive, driven once."""

from pathlib import Path

import pytest
from virtual_drive import SHORT_LANE_CHANGE, drive


@pytest.fixture(scope="session")
def recorded_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Log of two seconds in lockstep, with its journal beside it."""
    folder = tmp_path_factory.mktemp("recorded")
    log = folder / "run.log"
    drive(folder, "lti", "--scenario", SHORT_LANE_CHANGE, "--record", str(log))
    return log
