"""The work of `offline-report`: the evaluation, the lane change, and one page of both."""

from importlib.metadata import version
from pathlib import Path
from typing import Any

from offline.baselines.registry import SHIPPED, baseline_facts
from offline.commands.evaluation import Evaluation, evaluation_figures, run_evaluation
from offline.commands.options import EvaluationOptions
from offline.commands.terminal import STDERR, STDOUT
from offline.data.manifest import Imported, Manifest, Simulated
from offline.evaluation.comparison import LTI_BASELINES
from offline.evaluation.lane_change import drive_lane_change
from offline.evaluation.model_card import identity_facts, model_facts, stability_text
from offline.evaluation.predictor import predict_trajectories
from offline.evaluation.report import evaluation_page, lane_change_section
from rt_controller.contract.errors import OutputError
from rt_controller.contract.figures import require_writable
from rt_controller.contract.files import write_text
from rt_controller.report.page import Page, Section, render_page
from rt_controller.report.table import Fact, facts_table

PACKAGES = ("rt-controller", "numpy", "onnxruntime", "matplotlib")


def write_report(output: Path, options: EvaluationOptions) -> dict[str, Any]:
    """Figures of `offline-report`.

    Raises:
        ConfigError: the page cannot be written there; raised before the evaluation.
    """
    require_writable(output, "--output")
    evaluation = run_evaluation(options)
    with STDERR.status("drawing"):
        text = render_page(_page(evaluation))
    try:
        write_text(output, text)
    except OSError as error:
        raise OutputError(
            f"--output {output}: expected room for the page, found {error.strerror}. The fitted "
            f"baselines are in the cache: free some space and give the command again."
        ) from error
    STDOUT.print(f"{output}, {len(text.encode()) / 1e6:.1f} MB", soft_wrap=True)
    return evaluation_figures(evaluation)


def _page(evaluation: Evaluation) -> Page:
    comparison, dataset = evaluation.comparison, evaluation.dataset
    models = zip(comparison.models, evaluation.bundles, strict=True)
    sources = []
    for name, bundle in models:
        growth = f"{stability_text(bundle)}, observables in units of their spread"
        facts = [Fact("kind", bundle.name), *model_facts(bundle), Fact("growth", growth)]
        sources.append(facts_table([*facts, *identity_facts(bundle)], name))
    found = {name: baseline_facts(name, dataset) for name in comparison.baselines}
    if found:
        lines = (
            Fact(name, "; ".join(f"{fact.name} {fact.value}" for fact in facts))
            for name, facts in found.items()
        )
        sources.append(facts_table(lines, "Baselines"))
    software = [
        *_facts_of_data(dataset.manifest),
        Fact("revision", evaluation.revision),
        *(Fact(f"evaluated with {name}", version(name)) for name in PACKAGES),
    ]
    sources.append(facts_table(software, "Data and software"))
    lane_change = _lane_change(evaluation) if isinstance(dataset.origin, Simulated) else None
    return evaluation_page(comparison, sources, lane_change)


def _lane_change(evaluation: Evaluation) -> Section:
    """With more baselines than the linear models and the paper's network it would be unreadable."""
    comparison, driven = evaluation.comparison, drive_lane_change()
    shown = (*comparison.models, *LTI_BASELINES, SHIPPED)
    predicted = {
        name: predict_trajectories(model, driven.windows)
        for name, model in evaluation.predictors.items()
        if name in shown
    }
    return lane_change_section(driven, predicted, comparison)


def _facts_of_data(manifest: Manifest) -> list[Fact]:
    origin = manifest.origin
    facts = [
        Fact("data set, SHA-256", manifest.sha256),
        Fact("episodes, trajectories", f"{origin.episodes}, {manifest.trajectories}"),
        Fact("seed of the data and of their split", str(origin.seed)),
    ]
    if isinstance(origin, Imported):
        logs = [Fact(f"log {file.name}, SHA-256", file.sha256) for file in origin.files]
        return [*facts, *logs]
    roads = ", ".join(f"{1e3 * kappa:+g}e-3" for kappa in origin.recipe.curvatures_per_m)
    return [
        *facts,
        Fact("roads of the library", f"{roads} 1/m"),
        Fact("conditions", origin.recipe.text),
        Fact("fingerprint of the car", origin.plant_fingerprint),
        *(Fact(f"made with {name}", number) for name, number in manifest.versions.items()),
    ]
