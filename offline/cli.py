"""The four offline commands: data, train, export, evaluate.

Only argument parsing lives at the top; torch, numba and onnx are loaded by the command that needs
them.
"""

import json
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from importlib.util import find_spec
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from offline.config import PRESETS, TrainingConfig, resolve
from offline.terminal import CONSOLE, ERRORS, error_table, progress_bar
from rt_controller.contract.errors import ConfigError, MissingExtraError, RtControllerError

if TYPE_CHECKING:
    from offline.dataset import Dataset
    from offline.evaluate import Evaluation
    from rt_controller.contract.artifact import Bundle

RUNS = Path("runs")
INTERRUPTED = 130
"""exit code of a program that was asked to stop, as shells have it"""

Chosen = Annotated[TrainingConfig | None, Parameter(name="*")]

data_app = App(name="offline-data", help="Make the data set: episodes of the simulated car.")
train_app = App(name="offline-train", help="Train MDK-Net. The defaults are the paper's.")
export_app = App(name="offline-export", help="Make the bundle that rt-controller drives with.")
evaluate_app = App(
    name="offline-evaluate", help="Predict two seconds ahead on held-out data, beside the rivals."
)


def data_main() -> None:
    """Entry of `offline-data`."""
    _run(data_app)


def train_main() -> None:
    """Entry of `offline-train`."""
    _run(train_app)


def export_main() -> None:
    """Entry of `offline-export`."""
    _run(export_app)


def evaluate_main() -> None:
    """Entry of `offline-evaluate`."""
    _run(evaluate_app)


@data_app.default
def make_data(
    *,
    episodes: int = PRESETS["paper"].episodes,
    seed: int = PRESETS["paper"].data_seed,
    data: Path | None = None,
    jobs: int = -1,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
) -> int:
    """Make the data set of the paper's recipe, or check the one that is there.

    Parameters
    ----------
    episodes
        episodes of 10 s, five trajectories each
    seed
        of the random streams and of the split
    data
        folder of the data set; without it a cache folder, which is printed
    jobs
        processes; -1 is one per core
    json_file
        write the figures to this file
    """
    _require_offline()
    if episodes < 1:
        raise ConfigError(f"--episodes: expected at least 1, found {episodes}.")
    begun = time.monotonic()
    folder, dataset = _ensure_dataset(data, episodes, seed, jobs)
    wall_s = time.monotonic() - begun
    manifest = dataset.manifest
    CONSOLE.print(
        f"{manifest['trajectories']} trajectories of {manifest['episodes']} episodes, "
        f"{100 * manifest['rejected_fraction']:.1f} % of the tries rejected, "
        f"SHA-256 {dataset.sha256[:16]}…, {wall_s:.1f} s\n{folder}"
    )
    _write_json(
        json_file,
        {
            "folder": str(folder),
            "n_episodes": manifest["episodes"],
            "n_trajectories": manifest["trajectories"],
            "rejected_fraction": manifest["rejected_fraction"],
            "sha256": dataset.sha256,
            "wall_s": wall_s,
        },
    )
    return 0


@train_app.default
def train_model(
    *,
    config: Chosen = None,
    resume: Path | None = None,
    runs: Path = RUNS,
    data: Path | None = None,
    jobs: int = -1,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
) -> int:
    """Train a model; make the data set first where there is none.

    Ctrl-C ends the run after a checkpoint, with the command that resumes it.

    Parameters
    ----------
    resume
        go on with this run; only --steps and --threads may differ from its configuration
    runs
        folder that gets a new folder for each run
    data
        folder of the data set; without it a cache folder, which is printed
    jobs
        processes that make the data set; -1 is one per core
    json_file
        write the figures to this file
    """
    _require_offline()
    from offline.checkpoint import load_checkpoint
    from offline.dataset import load_dataset
    from offline.run_folder import create_run, extend_run, open_run
    from offline.train import Progress, train

    checkpoint = None
    if resume is None:
        resolved = resolve(config)
        folder, dataset = _ensure_dataset(data, resolved.episodes, resolved.data_seed, jobs)
        run = create_run(runs, resolved, folder, dataset.sha256, datetime.now())
    else:
        run = open_run(resume)
        run = extend_run(run, _continue_config(run.config, config))
        checkpoint = load_checkpoint(run.last)
        dataset = load_dataset(data or run.data_folder)
        if dataset.sha256 != run.data_sha256:
            raise ConfigError(
                f"--resume: expected the data set {run.data_sha256[:16]}… of that run, found "
                f"{dataset.sha256[:16]}… in {data or run.data_folder}. Name the right folder "
                f"with --data."
            )
    resolved = run.config
    CONSOLE.print(f"run {run.path}, data {run.data_folder}")
    first_step = checkpoint.step if checkpoint else 0
    begun = time.monotonic()

    with (
        progress_bar("training", resolved.steps, first_step) as show,
        _stop_on_signals() as stop_requested,
    ):
        shown = 0.0

        def on_progress(progress: Progress) -> None:
            nonlocal shown
            now = time.monotonic()
            if now - shown < 0.25 and progress.step < resolved.steps:
                return
            shown = now
            total, single_step, multi_step, stability, regularisation, states = progress.losses
            show(
                progress.step,
                f"loss {total:.4f} = ssl {single_step:.4f}, msl {multi_step:.4f} "
                f"(states {states:.4f}), sl {stability:.1e}, regl {regularisation:.3g} · "
                f"val {progress.validation_loss:.4f} (best {progress.best_validation_loss:.4f}) · "
                f"rho {progress.spectral_radius:.4f} · lr {progress.learning_rate:.1e}",
            )

        outcome = train(resolved, dataset, run, checkpoint, on_progress, stop_requested)

    wall_s = time.monotonic() - begun
    _write_json(
        json_file,
        {
            "run": str(run.path),
            "is_finished": outcome.is_finished,
            "step": outcome.step,
            "best_validation_loss": outcome.best_validation_loss,
            "skipped_steps": outcome.skipped,
            "wall_s": wall_s,
            "steps_per_s": (outcome.step - first_step) / max(wall_s, 1e-9),
        },
    )
    if not outcome.is_finished:
        CONSOLE.print(
            f"Stopped after step {outcome.step} of {resolved.steps}; nothing is lost. Go on with:\n"
            f"  offline-train --resume {run.path}"
        )
        return INTERRUPTED
    CONSOLE.print(
        f"Done in {wall_s:.0f} s, best validation loss {outcome.best_validation_loss:.4f}. "
        f"Next:\n  offline-export {run.path}"
    )
    return 0


@export_app.default
def export_model(
    run: Path | None = None,
    *,
    output: Path | None = None,
    lti: bool = False,
    data: Path | None = None,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
) -> int:
    """Export the best model of a run, or the linear rival of a data set.

    Parameters
    ----------
    run
        folder of the run; without it the latest
    output
        folder of the bundle; without it `bundle` in the folder of the run
    lti
        export the linear model of the data set instead
    data
        folder of the data set; without it the one the run was trained on
    json_file
        write the figures to this file
    """
    _require_offline()
    from offline.card import write_card
    from offline.checkpoint import load_checkpoint
    from offline.dataset import load_dataset
    from offline.export import choose_selftest_states, make_bundle, pass_gate
    from offline.run_folder import open_run
    from rt_controller.contract.artifact import save_bundle

    folder = run or RUNS / "latest"
    if lti:
        from offline.baselines.lti import fit_lti

        dataset = load_dataset(data) if data else _evaluation_data(folder)
        bundle = fit_lti(dataset, choose_selftest_states(dataset))
        gate = pass_gate(bundle)
        facts = {"method": "one-step least squares with offset on all training transitions"}
        target = output or RUNS / "lti"
    else:
        opened = open_run(folder)
        checkpoint = load_checkpoint(opened.best)
        dataset = load_dataset(data or opened.data_folder)
        bundle, gate = make_bundle(checkpoint, dataset)
        trained = load_checkpoint(opened.last).step
        facts = {
            "preset": checkpoint.config.preset,
            "steps": f"{trained} of {checkpoint.config.steps} trained, best model after step "
            f"{checkpoint.step}",
            "validation loss": f"{min(checkpoint.validation_losses):.5f}",
            "seed": str(checkpoint.config.seed),
            "revision": opened.revision,
            **opened.versions,
        }
        target = output or opened.bundle
    facts["data set"] = (
        f"{dataset.manifest['episodes']} episodes, {dataset.manifest['trajectories']} "
        f"trajectories, seed {dataset.manifest['seed']}"
    )
    evaluation = _evaluate(bundle, dataset)
    save_bundle(target, bundle, write_card(bundle, gate, evaluation, facts))
    CONSOLE.print(
        f"{bundle.name}: spectral radius {gate.spectral_radius:.5f}, "
        f"||A^20|| {gate.growth_20:.3g}, ||A^80|| {gate.growth_80:.3g}, "
        f"torch/ONNX {gate.parity:.1e}"
    )
    _print_evaluation(evaluation, per_curvature=False)
    CONSOLE.print(f"Drive with it:\n  rt-controller --model {target}")
    _write_json(
        json_file,
        {
            "bundle": str(target),
            "model": bundle.name,
            "spectral_radius": gate.spectral_radius,
            "growth_20": gate.growth_20,
            "growth_80": gate.growth_80,
            "parity": gate.parity,
            "size_bytes": sum(file.stat().st_size for file in target.iterdir()),
            **_evaluation_figures(evaluation),
        },
    )
    return 0


@evaluate_app.default
def evaluate_model(
    *,
    model: Path | None = None,
    data: Path | None = None,
    json_file: Annotated[Path | None, Parameter(name="--json")] = None,
) -> int:
    """Errors over 80 open-loop steps on the test trajectories, in the form of the paper's Table I.

    Parameters
    ----------
    model
        folder of a bundle; without it that of the latest run
    data
        folder of a data set; without it the full one if it is in the cache, else the one that the
        latest run was trained on
    json_file
        write the figures to this file
    """
    _require_offline()
    from offline.dataset import load_dataset
    from rt_controller.contract.artifact import load_bundle

    bundle = load_bundle(model or RUNS / "latest" / "bundle")
    dataset = load_dataset(data) if data else _evaluation_data(RUNS / "latest")
    evaluation = _evaluate(bundle, dataset)
    _print_evaluation(evaluation, per_curvature=True)
    _write_json(
        json_file,
        {
            "data_sha256": dataset.sha256,
            "is_training_data_of_model": dataset.sha256 == bundle.data_sha256,
            **_evaluation_figures(evaluation),
        },
    )
    return 0


def _run(app: App) -> None:
    try:
        app()
    except RtControllerError as error:
        ERRORS.print(f"{app.name[0]}: {error}", style="red", markup=False, highlight=False)
        sys.exit(error.exit_code)


def _require_offline() -> None:
    """Raise unless everything that the extra brings is installed."""
    missing = [
        name
        for name in ("torch", "numba", "onnx", "onnxscript", "joblib", "onnxruntime")
        if find_spec(name) is None
    ]
    if missing:
        raise MissingExtraError(
            f"training expects the extra 'offline', found no {', '.join(missing)}. "
            f'Run: pip install -e ".[offline]"'
        )


def _ensure_dataset(
    data: Path | None, episodes: int, seed: int, jobs: int
) -> tuple[Path, "Dataset"]:
    """The folder and the content of a data set, made now if it is not there."""
    from offline.dataset import cache_folder, exists, load_dataset, save_dataset
    from offline.excitation import Recipe
    from offline.generate import generate, plant_fingerprint

    recipe = Recipe()
    with CONSOLE.status("compiling the car"):
        fingerprint = plant_fingerprint()
    folder = data or cache_folder(recipe, episodes, seed, fingerprint)
    if exists(folder):
        return folder, load_dataset(folder)
    CONSOLE.print(f"data set: {episodes} episodes into {folder}")
    done = 0
    with progress_bar("driving", episodes) as show:

        def on_progress(more: int) -> None:
            nonlocal done
            done += more
            show(done, "")

        made = generate(recipe, episodes, seed, jobs, on_progress)
    dataset = save_dataset(folder, made.trajectories, made.rejected, recipe, seed, fingerprint)
    return folder, dataset


def _evaluation_data(run: Path) -> "Dataset":
    """The full data set if it is in the cache, else the one of the run."""
    from offline.dataset import cache_folder, exists, load_dataset
    from offline.excitation import Recipe
    from offline.generate import plant_fingerprint
    from offline.run_folder import open_run

    paper = PRESETS["paper"]
    folder = cache_folder(Recipe(), paper.episodes, paper.data_seed, plant_fingerprint())
    if not exists(folder):
        folder = open_run(run).data_folder
    CONSOLE.print(f"data {folder}")
    return load_dataset(folder)


def _continue_config(before: TrainingConfig, chosen: TrainingConfig | None) -> TrainingConfig:
    if chosen is None:
        return before
    explicit = {name: getattr(chosen, name) for name in chosen.model_fields_set}
    foreign = sorted(set(explicit) - {"steps", "threads"})
    if foreign:
        raise ConfigError(
            f"--resume: expected no other setting than --steps and --threads, found "
            f"{', '.join(foreign)}. Start a new run to change them."
        )
    return before.model_copy(update=explicit)


def _evaluate(bundle: "Bundle", dataset: "Dataset") -> "Evaluation":
    """The bundle beside its rivals, on the test trajectories of the data set."""
    from offline.baselines.lti import fit_lti
    from offline.baselines.persistence import PersistencePredictor
    from offline.evaluate import choose_test_trajectories, evaluate
    from offline.export import choose_selftest_states
    from offline.predictor import BundlePredictor

    lti = fit_lti(dataset, choose_selftest_states(dataset))
    models = {
        bundle.name: BundlePredictor(bundle),
        "lti": BundlePredictor(lti),
        "persistence": PersistencePredictor(),
    }
    return evaluate(models, choose_test_trajectories(dataset.select("test")))


def _print_evaluation(evaluation: "Evaluation", per_curvature: bool) -> None:
    from offline.evaluate import UNITS

    heads = tuple(f"{name} {unit}" for name, unit in UNITS.items())
    pooled = {name: tuple(errors) for name, errors in evaluation.pooled.items()}
    title = f"MSE over 80 steps, {evaluation.n_trajectories} test trajectories"
    CONSOLE.print(error_table(title, pooled, heads))
    if per_curvature:
        for curvature, by_model in evaluation.per_curvature.items():
            rows = {name: tuple(errors) for name, errors in by_model.items()}
            CONSOLE.print(error_table(f"curvature {curvature:g} 1/m", rows, heads))


def _evaluation_figures(evaluation: "Evaluation") -> dict[str, Any]:
    from offline.evaluate import UNITS

    return {
        "n_trajectories": evaluation.n_trajectories,
        "units": UNITS,
        "models": {
            name: {
                "mse": errors._asdict(),
                "mse_by_curvature_per_m": {
                    f"{curvature:g}": by_model[name]._asdict()
                    for curvature, by_model in evaluation.per_curvature.items()
                },
            }
            for name, errors in evaluation.pooled.items()
        },
    }


def _write_json(path: Path | None, figures: dict[str, Any]) -> None:
    if path is None:
        return
    try:
        path.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise ConfigError(
            f"--json: expected a file that can be written, found {path}: {error.strerror}."
        ) from error


@contextmanager
def _stop_on_signals() -> Iterator[Callable[[], bool]]:
    """Ctrl-C and a polite kill ask for a stop; a second one has its usual effect."""
    requested = False
    previous: dict[signal.Signals, Any] = {}

    def ask(number: int, frame: FrameType | None) -> None:
        nonlocal requested
        requested = True
        for sig, handler in previous.items():
            signal.signal(sig, handler)

    for sig in (signal.SIGINT, signal.SIGTERM):
        previous[sig] = signal.signal(sig, ask)
    try:
        yield lambda: requested
    finally:
        for sig, handler in previous.items():
            signal.signal(sig, handler)
