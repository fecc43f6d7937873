"""What the offline commands do: load, work, print, write.

Everything heavy is imported here, so only `offline.cli` imports this room, and late.
"""

import json
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from types import FrameType
from typing import Any

from offline.baselines.lti import fit_lti
from offline.baselines.persistence import PersistencePredictor
from offline.card import write_card
from offline.checkpoint import Checkpoint, load_checkpoint
from offline.config import PRESETS, TrainingConfig, resolve
from offline.dataset import Dataset, cache_folder, exists, load_dataset, save_dataset
from offline.evaluate import UNITS, Evaluation, choose_test_trajectories, evaluate
from offline.excitation import Recipe
from offline.export import Gate, choose_selftest_states, make_bundle, pass_gate
from offline.generate import generate, plant_fingerprint
from offline.predictor import BundlePredictor, Predictor
from offline.run_folder import RunFolder, create_run, extend_run, open_run
from offline.terminal import CONSOLE, error_table, progress_bar
from offline.train import Progress, train
from rt_controller.contract.artifact import Bundle, load_bundle, save_bundle
from rt_controller.contract.errors import ConfigError, DatasetError

INTERRUPTED = 130
"""exit code of a program that was asked to stop, as shells have it"""
REFRESH_S = 0.25
RESUMABLE_SETTINGS = {"steps", "threads"}


def make_data(
    episodes: int, seed: int, data: Path | None, jobs: int, json_file: Path | None
) -> int:
    """Exit code of `offline-data`."""
    begun = time.monotonic()
    folder, dataset = _ensure_dataset(data, episodes, seed, jobs)
    wall_s = time.monotonic() - begun
    manifest = dataset.manifest
    if (manifest["episodes"], manifest["seed"]) != (episodes, seed):
        raise DatasetError(
            f"{folder}: expected {episodes} episodes of seed {seed}, found a data set of "
            f"{manifest['episodes']} episodes of seed {manifest['seed']}. Choose another --data."
        )
    CONSOLE.print(
        f"{manifest['trajectories']} trajectories of {manifest['episodes']} episodes, "
        f"{100 * manifest['rejected_fraction']:.1f} % of the tries rejected, "
        f"SHA-256 {dataset.sha256[:16]}…, {wall_s:.1f} s\n{folder}",
        soft_wrap=True,
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


def train_model(
    chosen: TrainingConfig | None,
    runs: Path,
    data: Path | None,
    jobs: int,
    json_file: Path | None,
) -> int:
    """Exit code of `offline-train`: a new run."""
    config = resolve(chosen)
    folder, dataset = _ensure_dataset(data, config.episodes, config.data_seed, jobs)
    run = create_run(runs, config, folder, dataset.sha256, datetime.now())
    return _train(run, dataset, None, json_file)


def resume_training(
    path: Path, chosen: TrainingConfig | None, data: Path | None, json_file: Path | None
) -> int:
    """Exit code of `offline-train --resume`: an old run goes on."""
    run = open_run(path)
    run = extend_run(run, _config_to_resume(run.config, chosen))
    checkpoint = load_checkpoint(run.last)
    dataset = load_dataset(data or run.data_folder)
    if dataset.sha256 != run.data_sha256:
        raise ConfigError(
            f"--resume: expected the data set {run.data_sha256[:16]}… of that run, found "
            f"{dataset.sha256[:16]}… in {data or run.data_folder}. Name the right folder with "
            f"--data."
        )
    return _train(run, dataset, checkpoint, json_file)


def export_run(path: Path, output: Path | None, data: Path | None, json_file: Path | None) -> int:
    """Exit code of `offline-export`: the best model of a run."""
    run = open_run(path)
    checkpoint = load_checkpoint(run.best)
    dataset = load_dataset(data or run.data_folder)
    bundle, gate = make_bundle(checkpoint, dataset)
    facts = {
        "preset": checkpoint.config.preset,
        "steps": f"{load_checkpoint(run.last).step} of {run.config.steps} trained; this model is "
        f"the best of them, after step {checkpoint.step}",
        "validation loss": f"{min(checkpoint.validation_losses):.5f}",
        "seed": str(checkpoint.config.seed),
        "revision": run.revision,
        **{f"version of {name}": number for name, number in run.versions.items()},
    }
    return _deliver(bundle, gate, facts, dataset, output or run.bundle, json_file)


def export_lti(data: Path | None, output: Path, run: Path, json_file: Path | None) -> int:
    """Exit code of `offline-export --lti`: the linear model of a data set."""
    dataset = load_dataset(data) if data else _evaluation_data(run)
    bundle = fit_lti(dataset, choose_selftest_states(dataset))
    facts = {"method": "one-step least squares with offset on all training transitions"}
    return _deliver(bundle, pass_gate(bundle), facts, dataset, output, json_file)


def evaluate_model(model: Path, data: Path | None, run: Path, json_file: Path | None) -> int:
    """Exit code of `offline-evaluate`."""
    bundle = load_bundle(model)
    dataset = load_dataset(data) if data else _evaluation_data(run)
    evaluation = _evaluate(bundle, dataset)
    _print_pooled(evaluation)
    for curvature, by_model in evaluation.per_curvature.items():
        CONSOLE.print(error_table(f"curvature {curvature:g} 1/m", by_model, _heads()))
    _write_json(json_file, {"data_sha256": dataset.sha256, **_evaluation_figures(evaluation)})
    return 0


def _train(
    run: RunFolder, dataset: Dataset, checkpoint: Checkpoint | None, json_file: Path | None
) -> int:
    config = run.config
    CONSOLE.print(f"run {run.path}\ndata {run.data_folder}", soft_wrap=True)
    first_step = checkpoint.step if checkpoint else 0
    begun = time.monotonic()
    with (
        progress_bar("training", config.steps, first_step) as show,
        _stop_on_signals() as stop_requested,
    ):
        shown = 0.0

        def on_progress(progress: Progress) -> None:
            nonlocal shown
            now = time.monotonic()
            if now - shown >= REFRESH_S or progress.step == config.steps:
                shown = now
                show(progress.step, _describe(progress))

        outcome = train(
            config,
            dataset,
            run,
            resume_from=checkpoint,
            on_progress=on_progress,
            stop_requested=stop_requested,
        )
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
            f"Stopped after step {outcome.step} of {config.steps}; nothing is lost. Go on with:\n"
            f"  offline-train --resume {run.path}",
            soft_wrap=True,
        )
        return INTERRUPTED
    CONSOLE.print(
        f"Done in {wall_s:.0f} s, best validation loss {outcome.best_validation_loss:.4f}. "
        f"Next:\n  offline-export {run.path}",
        soft_wrap=True,
    )
    return 0


def _describe(progress: Progress) -> str:
    losses = progress.losses
    return (
        f"loss {losses.total.item():.4f}: single step {losses.single_step.item():.4f}, "
        f"multi step {losses.multi_step.item():.4f} (states {losses.states.item():.4f}), "
        f"stability {losses.stability.item():.1e}, "
        f"regularisation {losses.regularisation.item():.4g}\n"
        f"validation {progress.validation_loss:.4f}, best {progress.best_validation_loss:.4f}, "
        f"spectral radius {progress.spectral_radius:.4f}, rate {progress.learning_rate:.1e}"
    )


def _deliver(
    bundle: Bundle,
    gate: Gate,
    facts: dict[str, str],
    dataset: Dataset,
    target: Path,
    json_file: Path | None,
) -> int:
    """Judge a bundle, write it with its card, and say how to drive with it."""
    manifest = dataset.manifest
    facts["data set"] = (
        f"{manifest['episodes']} episodes, {manifest['trajectories']} trajectories, "
        f"seed {manifest['seed']}"
    )
    evaluation = _evaluate(bundle, dataset)
    try:
        save_bundle(target, bundle, write_card(bundle, gate, evaluation, facts))
    except OSError as error:
        raise ConfigError(
            f"--output: expected a folder with room for a bundle, found {target}: {error.strerror}."
        ) from error
    CONSOLE.print(
        f"{bundle.name}: spectral radius {gate.spectral_radius:.5f}, "
        f"||A^20|| {gate.growth_20:.3g}, ||A^80|| {gate.growth_80:.3g}, "
        f"torch/ONNX {gate.parity:.1e}"
    )
    _print_pooled(evaluation)
    CONSOLE.print(f"Drive with it:\n  rt-controller --bus virtual --model {target}", soft_wrap=True)
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


def _ensure_dataset(data: Path | None, episodes: int, seed: int, jobs: int) -> tuple[Path, Dataset]:
    """The folder and the content of a data set, made now if it is not there."""
    recipe = Recipe()
    with CONSOLE.status("compiling the car"):
        fingerprint = plant_fingerprint()
    folder = data or cache_folder(recipe, episodes, seed, fingerprint)
    if exists(folder):
        return folder, load_dataset(folder)
    CONSOLE.print(f"making a data set of {episodes} episodes in {folder}", soft_wrap=True)
    done = 0
    with progress_bar("driving", episodes) as show:

        def on_progress(more: int) -> None:
            nonlocal done
            done += more
            show(done, "")

        made = generate(recipe, episodes, seed, jobs, on_progress)
    dataset = save_dataset(
        folder,
        made.trajectories,
        rejected=made.rejected,
        recipe=recipe,
        seed=seed,
        plant_fingerprint=fingerprint,
    )
    return folder, dataset


def _evaluation_data(run: Path) -> Dataset:
    """The full data set if it is in the cache, else the one of the run."""
    paper = PRESETS["paper"]
    folder = cache_folder(Recipe(), paper.episodes, paper.data_seed, plant_fingerprint())
    if not exists(folder):
        folder = open_run(run).data_folder
    CONSOLE.print(f"data {folder}", soft_wrap=True)
    return load_dataset(folder)


def _config_to_resume(before: TrainingConfig, chosen: TrainingConfig | None) -> TrainingConfig:
    if chosen is None:
        return before
    foreign = sorted(chosen.model_fields_set - RESUMABLE_SETTINGS)
    if foreign:
        raise ConfigError(
            f"--resume: expected no other setting than --steps and --threads, found "
            f"{', '.join(foreign)}. Start a new run to change them."
        )
    explicit = {name: getattr(chosen, name) for name in chosen.model_fields_set}
    return before.model_copy(update=explicit)


def _evaluate(bundle: Bundle, dataset: Dataset) -> Evaluation:
    """The bundle beside its rivals, on the test trajectories of the data set."""
    lti = fit_lti(dataset, choose_selftest_states(dataset))
    models: dict[str, Predictor] = {
        bundle.name: BundlePredictor(bundle),
        "lti": BundlePredictor(lti),
        "persistence": PersistencePredictor(),
    }
    return evaluate(models, choose_test_trajectories(dataset.select("test")))


def _heads() -> tuple[str, ...]:
    return tuple(f"{name}\n{unit}" for name, unit in UNITS.items())


def _print_pooled(evaluation: Evaluation) -> None:
    title = f"MSE over 80 steps, {evaluation.n_trajectories} test trajectories"
    CONSOLE.print(error_table(title, evaluation.pooled, _heads()))


def _evaluation_figures(evaluation: Evaluation) -> dict[str, Any]:
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
    if path is not None:
        path.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


@contextmanager
def _stop_on_signals() -> Iterator[Callable[[], bool]]:
    """Ctrl-C and a polite kill ask for a stop; a second one has its usual effect."""
    requested = False
    previous: dict[signal.Signals, Any] = {}

    def restore() -> None:
        for number, handler in previous.items():
            signal.signal(number, handler)

    def ask(number: int, frame: FrameType | None) -> None:
        nonlocal requested
        requested = True
        restore()

    for number in (signal.SIGINT, signal.SIGTERM):
        previous[number] = signal.signal(number, ask)
    try:
        yield lambda: requested
    finally:
        restore()
