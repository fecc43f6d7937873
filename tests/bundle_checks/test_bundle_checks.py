"""A bundle plans as where it was exported, or is refused."""

from dataclasses import replace

import numpy as np
import pytest

from rt_controller.bundle_checks.plan_check import SITUATIONS, require_stored_plans, with_plans
from rt_controller.config import MpcSettings
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import VEHICLE
from rt_controller.model.artifact import load_bundle, save_bundle, shipped_model
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_mpc


@pytest.fixture(scope="module", params=["lti", "mdk-net"])
def exported(request: pytest.FixtureRequest) -> Bundle:
    return with_plans(load_bundle(shipped_model(request.param)))


def test_plans_are_stored_and_repeated_from_the_files(exported, tmp_path):
    save_bundle(tmp_path, exported, "card")
    loaded = load_bundle(tmp_path)
    _, brake_n, steer_rad = np.moveaxis(loaded.plans.inputs, 2, 0)
    assert brake_n.max() > 1.0
    assert steer_rad.min() < -0.05 < 0.05 < steer_rad.max()
    assert loaded.plans.inputs.shape == (len(SITUATIONS), 20, 3)
    assert loaded.sha256 == exported.sha256
    require_stored_plans(loaded)


@pytest.mark.parametrize("part", ["A", "B_uc", "c", "road"])
def test_another_model_with_a_hash_of_its_own_is_refused(exported, tmp_path, part):
    A, B_uc, B_uw, c, movement = (
        getattr(exported, name) for name in ("A", "B_uc", "B_uw", "c", "movement")
    )
    turned = (
        {"B_uw": -B_uw}
        if movement is None
        else {"movement": movement._replace(s0=movement.s0 + 0.01)}
    )
    changed = {"A": {"A": 1.02 * A}, "B_uc": {"B_uc": -B_uc}, "c": {"c": c + 0.05 * (c != 0.0)}}
    save_bundle(tmp_path, replace(exported, **{**changed, "road": turned}[part]), "card")
    with pytest.raises(ArtifactError, match=r"stored at its export .* found a difference"):
        build_mpc(load_bundle(tmp_path), MpcSettings())


def test_a_model_that_cannot_be_driven_with_gets_no_plans():
    lti = replace(load_bundle(shipped_model("lti")), plans=None)
    slow = replace(lti, schema=replace(VEHICLE, dt_s=0.05))
    assert with_plans(slow).plans is None


def test_plans_over_another_horizon_are_refused(exported):
    short = exported.plans._replace(inputs=exported.plans.inputs[:, :10])
    with pytest.raises(ArtifactError, match="expected stored plans of 20 periods, found plans of"):
        require_stored_plans(replace(exported, plans=short))
