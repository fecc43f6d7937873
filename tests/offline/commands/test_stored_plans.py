"""`offline-export --bundle`: stored plans for a model that was exported without them."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from offline import cli
from rt_controller.bundle_checks.plan_check import require_stored_plans
from rt_controller.contract.signals import VEHICLE
from rt_controller.model.artifact import load_bundle, save_bundle, shipped_model


def export(monkeypatch: pytest.MonkeyPatch, *options: str | Path) -> int:
    monkeypatch.setattr(sys, "argv", ["offline-export", *map(str, options)])
    with pytest.raises(SystemExit) as ended:
        cli.export_main()
    return int(ended.value.code or 0)


@pytest.fixture
def without_plans(tmp_path: Path) -> Path:
    folder = tmp_path / "old"
    save_bundle(folder, replace(load_bundle(shipped_model("lti")), plans=None), "# a card")
    return folder


def test_a_bundle_gets_plans_in_its_folder_and_stays_the_same_model(
    without_plans: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    before, figures = load_bundle(without_plans), tmp_path / "figures.json"
    assert export(monkeypatch, "--bundle", without_plans, "--json", figures) == 0
    after = load_bundle(without_plans)
    assert after.plans is not None
    require_stored_plans(after)
    assert after.sha256 == before.sha256
    assert (without_plans / "card.md").read_text() == "# a card"
    assert json.loads(figures.read_text())["plans"] == len(after.plans.inputs)


def test_plans_of_another_model_are_replaced_and_it_is_said(
    without_plans: Path,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    export(monkeypatch, "--bundle", without_plans, "--output", tmp_path / "new")
    assert load_bundle(without_plans).plans is None
    planned = load_bundle(tmp_path / "new")
    save_bundle(without_plans, replace(planned, B_uc=1.5 * planned.B_uc), "# a card")
    capsys.readouterr()
    assert export(monkeypatch, "--bundle", without_plans) == 0
    assert "its own plans were replaced" in capsys.readouterr().out
    require_stored_plans(load_bundle(without_plans))


def test_a_model_that_is_not_driven_with_is_refused(
    without_plans: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    slow = replace(load_bundle(without_plans), schema=replace(VEHICLE, dt_s=0.05))
    save_bundle(without_plans, slow, "card")
    assert export(monkeypatch, "--bundle", without_plans) == 2


@pytest.mark.parametrize("other", [("--baseline", "lti"), ("--data", "d"), ("runs/mine",)])
def test_a_bundle_is_exported_alone(
    without_plans: Path, monkeypatch: pytest.MonkeyPatch, other: tuple[str, ...]
) -> None:
    assert export(monkeypatch, *other, "--bundle", without_plans) == 2


@pytest.mark.parametrize("name", ["lti", "mdk-net", "mdk-net-paper"])
def test_the_shipped_models_have_stored_plans(name: str) -> None:
    """Without them: offline-export --bundle NAME."""
    assert load_bundle(shipped_model(name)).plans is not None
