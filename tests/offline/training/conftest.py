"""The presets, reduced to the size of a test."""

import pytest


@pytest.fixture(params=["paper", "recommended"])
def config(request, tiny_config, tiny_recommended):
    return {"paper": tiny_config, "recommended": tiny_recommended}[request.param]
