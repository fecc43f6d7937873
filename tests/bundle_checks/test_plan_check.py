"""A bundle plans as where it was exported, or is refused."""

from dataclasses import replace
from pathlib import Path

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


def test_plans_are_stored_and_repeated_from_the_files(exported: Bundle, tmp_path: Path) -> None:
    save_bundle(tmp_path, exported, "card")
    loaded = load_bundle(tmp_path)
    assert loaded.plans is not None
    assert loaded.plans.inputs.shape == (len(SITUATIONS), 20, 3)
    assert loaded.sha256 == exported.sha256
    require_stored_plans(loaded)


def test_the_situations_use_both_pedals_and_both_directions(exported: Bundle) -> None:
    assert exported.plans is not None
    throttle, brake_n, steer_rad = np.moveaxis(exported.plans.inputs, 2, 0)
    assert throttle.max() > 0.1
    assert brake_n.max() > 1.0
    assert steer_rad.min() < -0.05 < 0.05 < steer_rad.max()


@pytest.mark.parametrize("matrix", ["A", "B_uc", "B_uw", "c"])
def test_another_model_with_a_hash_of_its_own_is_refused(
    exported: Bundle, tmp_path: Path, matrix: str
) -> None:
    values = getattr(exported, matrix)
    other = values + 0.05 if matrix == "c" else 1.02 * values if matrix == "A" else -values
    save_bundle(tmp_path, replace(exported, **{matrix: other}), "card")
    with pytest.raises(ArtifactError, match=r"stored at its export .* found a difference"):
        build_mpc(load_bundle(tmp_path), MpcSettings())


@pytest.mark.parametrize("input_", range(3))
def test_one_negated_input_is_refused(exported: Bundle, input_: int) -> None:
    signs = np.ones(3)
    signs[input_] = -1.0
    gains = exported.gains
    if gains is not None:
        gains = gains._replace(N=gains.N * np.append(signs, [1.0, 1.0])[gains.factor])
    with pytest.raises(ArtifactError, match="found"):
        require_stored_plans(replace(exported, B_uc=exported.B_uc * signs, gains=gains))


def test_a_bundle_without_plans_drives(tmp_path: Path) -> None:
    older = replace(load_bundle(shipped_model("lti")), plans=None)
    save_bundle(tmp_path, older, "card")
    loaded = load_bundle(tmp_path)
    assert loaded.plans is None
    require_stored_plans(loaded)


def test_the_newer_format_needs_its_plans(exported: Bundle, tmp_path: Path) -> None:
    save_bundle(tmp_path, exported, "card")
    with np.load(tmp_path / "koopman.npz") as archive:
        arrays = {name: archive[name] for name in archive.files if name != "plan_inputs"}
    np.savez(tmp_path / "koopman.npz", **arrays)
    with pytest.raises(ArtifactError, match="expected a field 'plan_inputs'"):
        load_bundle(tmp_path)


def test_a_model_that_cannot_be_driven_with_gets_no_plans() -> None:
    lti = replace(load_bundle(shipped_model("lti")), plans=None)
    slow = replace(lti, schema=replace(VEHICLE, dt_s=0.05))
    assert with_plans(slow).plans is None


def test_plans_over_another_horizon_are_refused(exported: Bundle) -> None:
    assert exported.plans is not None
    short = exported.plans._replace(inputs=exported.plans.inputs[:, :10])
    with pytest.raises(ArtifactError, match="expected stored plans of 20 periods, found plans of"):
        require_stored_plans(replace(exported, plans=short))
