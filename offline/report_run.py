"""What `offline-report` does: the evaluation, the lane change, and one page of both."""

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from offline.card import Fact, describe_model
from offline.evaluation_run import Evaluation, evaluation_figures, run_evaluation
from offline.judgement import LTI_RIVALS
from offline.lane_change import drive_lane_change, predict_windows
from offline.manifest import Driven, Imported, Manifest
from offline.report.canvas import pens
from offline.report.lane_change_plot import lane_change_plot
from offline.report.page import Contents, Scene, Subject, page
from offline.rivals import SHIPPED, describe_rival
from offline.terminal import CONSOLE
from rt_controller.contract.artifact import Bundle
from rt_controller.contract.errors import ConfigError, RtControllerError
from rt_controller.contract.figures import find_obstacle, write_figures

PACKAGES = ("rt-controller", "numpy", "onnxruntime", "matplotlib")


def write_report(
    output: Path,
    models: Sequence[Path],
    data: Path | None,
    run: Path,
    rivals: Sequence[str],
    sets: Sequence[str],
    json_file: Path | None,
) -> int:
    """Exit code of `offline-report`.

    Raises:
        ConfigError: the page cannot be written there; found before the work.
    """
    require_writable_page(output)
    evaluation = run_evaluation(models, data, run, rivals, sets)
    with CONSOLE.status("drawing"):
        text = page(_contents(evaluation))
    write_figures(json_file, evaluation_figures(evaluation))
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RtControllerError(
            f"--output {output}: expected room for the page, found {error.strerror}. What was "
            f"fitted and made for it is kept: free some space and give the command again."
        ) from error
    CONSOLE.print(f"{output}, {len(text.encode()) / 1e6:.1f} MB", soft_wrap=True)
    return 0


def require_writable_page(output: Path) -> None:
    """Return if the page can be written there later.

    Raises:
        ConfigError: it cannot.
    """
    obstacle = find_obstacle(output)
    if obstacle is not None:
        raise ConfigError(
            f"--output {output}: expected a file that can be written, found {obstacle}. Name "
            f"another file, in a folder that exists."
        )


def _contents(evaluation: Evaluation) -> Contents:
    judgement = evaluation.judgement
    subjects = [
        Subject(name, _facts_of_model(bundle))
        for name, bundle in zip(judgement.judged, evaluation.judged, strict=True)
    ]
    dataset = evaluation.dataset
    manifest = dataset.manifest
    rivals = [
        Subject(name, [Fact(*fact) for fact in describe_rival(name, dataset)])
        for name in judgement.rivals
    ]
    return Contents(
        judgement,
        subjects,
        rivals,
        [*_facts_of_data(manifest), *_facts_of_software(evaluation.revision)],
        _lane_change(evaluation) if isinstance(manifest.origin, Driven) else None,
    )


def _lane_change(evaluation: Evaluation) -> Scene:
    """The judged models beside the paper's rival and the paper's network: all would be a tangle."""
    judgement, driven = evaluation.judgement, drive_lane_change()
    shown = (*judgement.judged, *LTI_RIVALS, SHIPPED)
    foreseen = {
        name: predict_windows(model, driven.windows)
        for name, model in evaluation.predictors.items()
        if name in shown
    }
    drawn = pens(judgement.judged, judgement.rivals)
    return Scene(driven.words, lane_change_plot(driven, foreseen, drawn, judgement.judged))


def _facts_of_model(bundle: Bundle) -> list[Fact]:
    return [
        Fact("kind", bundle.name),
        *describe_model(bundle),
        Fact(
            "growth",
            f"spectral radius {bundle.spectral_radius:.5f}, ||A^20|| {bundle.growth(20):.3g}, "
            f"||A^80|| {bundle.growth(80):.3g}, observables in units of their spread",
        ),
        Fact("model, SHA-256", bundle.sha256),
        Fact("trained on data set, SHA-256", bundle.data_sha256),
    ]


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
        Fact("fingerprint of the car", origin.plant_fingerprint),
        *(Fact(f"made with {name}", number) for name, number in manifest.versions.items()),
    ]


def _facts_of_software(revision: str) -> list[Fact]:
    packages = [Fact(f"judged with {name}", version(name)) for name in PACKAGES]
    return [Fact("revision", revision), *packages]
