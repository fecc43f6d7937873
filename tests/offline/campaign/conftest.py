"""A Dask cluster of two real worker processes for the tests that do not harm it, and Ray's room."""

import os
import secrets
from collections.abc import Iterator
from importlib.util import find_spec

import pytest
from dask_cluster import RIGS, DaskCluster, dask_cluster


@pytest.fixture(scope="session")
def cluster(tmp_path_factory) -> Iterator[DaskCluster]:
    with dask_cluster(tmp_path_factory.mktemp("dask")) as running:
        yield running


@pytest.fixture(scope="session")
def ray_environment() -> Iterator[None]:
    """Ray's workers find the rigs, and its clusters have a password of their own.

    Ray reads this once, when it is first imported: so nothing may import it before.
    """
    if find_spec("ray") is None:
        pytest.skip("Ray is not installed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(RIGS), prepend=os.pathsep)
        patch.setenv("RAY_AUTH_MODE", "token")
        patch.setenv("RAY_AUTH_TOKEN", secrets.token_hex(32))
        yield
