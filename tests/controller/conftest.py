"""A controller with the shipped linear model, and its scripted vehicle."""

from collections.abc import Iterator

import pytest
from scripted_vehicle import Rig, build_rig

from rt_controller.config import MpcSettings
from rt_controller.contract.artifact import load_bundle, shipped_model
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.control.mpc import Mpc


@pytest.fixture(scope="session")
def mpc_of_session() -> Mpc:
    settings = MpcSettings()
    return Mpc(load_bundle(shipped_model("lti")), settings.horizon, settings.cost(), INPUT_LIMITS)


@pytest.fixture(scope="session")
def mpc_of_three_stages() -> Mpc:
    settings = MpcSettings(horizon=3)
    return Mpc(load_bundle(shipped_model("lti")), 3, settings.cost(), INPUT_LIMITS)


@pytest.fixture
def rig(mpc_of_session: Mpc) -> Iterator[Rig]:
    with build_rig(mpc_of_session) as built:
        yield built
