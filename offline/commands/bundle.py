"""The work of `offline-export`: check a model, compare it with baselines, write the bundle."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from offline.baselines import registry
from offline.baselines.registry import baseline_facts, compare_with_plain_baselines
from offline.commands.model_trial import NOT_TRIED, try_model
from offline.commands.terminal import STDERR, STDOUT
from offline.config import PAST_STEPS
from offline.data.dataset import Dataset, exists, load_dataset
from offline.data.generate import full_folder
from offline.data.manifest import describe_car
from offline.data.signals import past_names
from offline.evaluation.comparison import library_figures
from offline.evaluation.model_card import driven_text, stability_text, write_card
from offline.evaluation.tables import mse_table
from offline.files import source_revision
from offline.model.export_checks import ExportFigures, check_export
from offline.model.physical_units import choose_selftest
from offline.training.export import export_checkpoint
from offline.training.run import load_checkpoint, open_run
from rt_controller.bundle_checks.plan_check import with_plans
from rt_controller.contract.errors import ConfigError
from rt_controller.model.artifact import save_bundle
from rt_controller.model.bundle import Bundle
from rt_controller.model.lift import Lift
from rt_controller.model.validation import find_objection_to_driving
from rt_controller.report.table import Fact, print_table


def export_run(
    path: Path, output: Path | None, data: Path | None, is_tried: bool = True
) -> dict[str, Any]:
    """Figures of `offline-export` for the best model of a run; `is_tried` on the simulated car."""
    run = open_run(path)
    checkpoint = load_checkpoint(run.best)
    dataset = load_dataset(data or run.data_folder)
    bundle, checks = export_checkpoint(checkpoint, dataset)
    facts = [
        Fact("preset", checkpoint.config.preset),
        Fact(
            "steps",
            f"{load_checkpoint(run.last).step} of {run.config.steps} trained; the best model is "
            f"that after step {checkpoint.step}",
        ),
        # The best checkpoint is written right after its evaluation.
        Fact("validation loss", f"{checkpoint.validation_losses[-1]:.5f}"),
        Fact("seed", str(checkpoint.config.seed)),
        Fact("revision, trained", run.revision),
        *(Fact(f"version of {name}", number) for name, number in run.versions.items()),
    ]
    return _deliver(bundle, checks, facts, dataset, output or run.bundle, is_tried)


def export_baseline(
    name: str, data: Path | None, output: Path, run: Path, is_tried: bool = True
) -> dict[str, Any]:
    """Figures of `offline-export --baseline`.

    Raises:
        ConfigError: no controller can plan with that baseline.
    """
    to_bundle = registry.find_baseline(name).to_bundle
    if to_bundle is None:
        drivable = [each for each in registry.names() if registry.find_baseline(each).to_bundle]
        raise ConfigError(
            f"--baseline {name}: expected a model that is linear or bilinear in the lifted state, "
            f"so that a convex QP can plan with it, found another kind. Take one of "
            f"{', '.join(drivable)}."
        )
    full = full_folder()
    folder = data or (full if exists(full) else open_run(run).data_folder)
    STDERR.print(f"data {folder}", soft_wrap=True)
    dataset = load_dataset(folder)
    whole_past = Lift(True, PAST_STEPS, past_names(dataset.schema, dataset.roles))
    with STDERR.status(f"baseline {name}"):
        baseline = registry.fit(name, dataset)
    bundle = to_bundle(name, baseline, dataset, choose_selftest(dataset, whole_past))
    facts = baseline_facts(name, dataset)
    return _deliver(bundle, check_export(bundle, dataset), facts, dataset, output, is_tried)


def _deliver(
    bundle: Bundle,
    checks: ExportFigures,
    facts: Sequence[Fact],
    dataset: Dataset,
    target: Path,
    is_tried: bool,
) -> dict[str, Any]:
    """Evaluate a bundle, write it with its card, and print how to drive with it."""
    revision = source_revision()
    origin = dataset.origin
    data = (
        f"{origin.episodes} episodes, {dataset.manifest.trajectories} trajectories, "
        f"seed {origin.seed}"
    )
    car = Fact("car", describe_car(origin))
    facts = [*facts, Fact("revision, exported", revision), Fact("data set", data), car]
    comparison = compare_with_plain_baselines(bundle, dataset)
    bundle = with_plans(bundle)
    trial, trial_figures = try_model(bundle) if is_tried else (NOT_TRIED, None)
    facts.append(Fact("trial", trial))
    try:
        save_bundle(target, bundle, write_card(bundle, checks, comparison, facts))
    except OSError as error:
        raise ConfigError(
            f"--output: expected a folder with room for a bundle, found {target}: {error.strerror}."
        ) from error
    STDOUT.print(
        f"{bundle.name}: {stability_text(bundle)}; {driven_text(checks.stability)}; torch/ONNX "
        f"{checks.parity:.1e}",
        soft_wrap=True,
    )
    STDOUT.print(f"{car.name}: {car.value}\ntrial: {trial}", soft_wrap=True)
    print_table(mse_table(comparison, comparison.sets[0]), STDOUT)
    objection = find_objection_to_driving(bundle)
    STDOUT.print(
        f"Drive with it:\n  rt-controller --bus virtual --model {target}"
        if objection is None
        else objection,
        soft_wrap=True,
    )
    return {
        "bundle": str(target),
        "model": bundle.name,
        "model_sha256": bundle.sha256,
        "car": car.value,
        "trial": None if trial_figures is None else trial_figures._asdict(),
        "revision": revision,
        "spectral_radius": bundle.spectral_radius,
        "growth_20": bundle.growth(20),
        "growth_80": bundle.growth(80),
        "driven_radius": {name: part.radius for name, part in checks.stability._asdict().items()},
        "driven_growth_80": {
            name: part.growth for name, part in checks.stability._asdict().items()
        },
        "persistence_mse_over_model_mse": dict(
            zip(dataset.schema.state_names, checks.persistence_over_model.tolist(), strict=True)
        ),
        "parity": checks.parity,
        "size_bytes": sum(file.stat().st_size for file in target.iterdir()),
        **library_figures(comparison),
    }
