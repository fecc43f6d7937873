"""The scaling of the toy car."""

import pytest

from offline.data.signals import VEHICLE_ROLES, Scaling, fit_scaling
from rt_controller.contract.signals import VEHICLE


@pytest.fixture(scope="module")
def scaling(toy_dataset) -> Scaling:
    return fit_scaling(toy_dataset.select("train"), VEHICLE, VEHICLE_ROLES)
