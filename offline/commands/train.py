"""`offline-train`: a new or resumed run with a progress bar, stopped by Ctrl-C."""

import time
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from offline.commands.options import RUNS, Config, DataFolder, JsonFile, require_ready
from offline.commands.terminal import STDERR, print_plain, progress_bar, quoted, stop_on_signals
from offline.config import TrainingConfig, explicit_fields, resolve
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import require_folder, write_figures
from rt_controller.terminal.command_line import new_app, run_command
from rt_controller.terminal.entry import INTERRUPTED
from sim_bridge.campaign import THIS_MACHINE, Backend

if TYPE_CHECKING:
    from offline.data.dataset import Dataset
    from offline.training.run import Checkpoint, RunFolder
    from offline.training.state import TrainingState
    from rt_controller.model.bundle import Bundle

GROUPS = {
    "Main options": "preset steps seed data resume runs init json",
    "Data": "episodes data-seed windows rare-share near-roads noise",
    "Optimisation": "batch optimizer learning-rate matrix-rate operator-rate rate-schedule "
    "patience evaluate-every gradient-clip best-rule",
    "Loss": "objective horizon-start horizon-growth forgetting weight-single-step "
    "weight-multi-step weight-stability weight-regularisation decay-encoder decay-operator "
    "operator-prior stability through-last-step",
    "Model": "activation hidden latents latents-start constant-observable lift-exogenous products "
    "history-steps separate-motion symmetry bilinear-rank "
    "saturating-gains drift-rank bilinear-follows",
    "Machine": "threads device backend address jobs",
}
"""options of the command by group"""
REFRESH_S = 0.25
RESUMABLE_SETTINGS = {"steps", "threads"}

app = new_app(
    "offline-train",
    "Train a model; the defaults are those of the preset recommended.",
    groups=GROUPS,
)
main = partial(run_command, app)


@app.default
def train(
    *,
    config: Config = None,
    resume: Path | None = None,
    runs: Path = RUNS,
    data: DataFolder = None,
    backend: Backend = THIS_MACHINE,
    json_file: JsonFile = None,
) -> int:
    """Train a model, on the data set --data or on one in the cache, which is made if necessary.

    Ctrl-C ends the run after a checkpoint and prints the command that resumes it.

    Args:
        resume: continue this run; only --threads may differ from its configuration, and --steps if
            its learning rate follows no cosine
        runs: folder that gets a new folder for each run
    """
    require_ready(json_file)
    require_folder(runs, "--runs")
    if resume is not None:
        figures, exit_code = resume_run(resume, config, data)
    else:
        figures, exit_code = start_run(config, runs, data, backend)
    write_figures(json_file, figures)
    return exit_code


def start_run(
    chosen: TrainingConfig | None, runs: Path, data: Path | None, backend: Backend
) -> tuple[dict[str, Any], int]:
    """Figures and exit code of a new run."""
    from offline.commands.dataset import config_of_data, ensure_dataset
    from offline.training.initial import with_structure_of
    from offline.training.run import create_run
    from offline.training.state import find_device
    from rt_controller.model.artifact import find_model, load_bundle

    config = resolve(chosen)
    find_device(config.device)
    folder, dataset = ensure_dataset(data, config, backend)
    config = config_of_data(folder, dataset.origin, config, chosen)
    first_model = None
    if config.init is not None:
        first_model = load_bundle(find_model(config.init))
        config = with_structure_of(first_model, config, explicit_fields(chosen))
    run = create_run(runs, config, folder, dataset.sha256, datetime.now())
    return _run(run, dataset, first_model=first_model)


def resume_run(
    path: Path, chosen: TrainingConfig | None, data: Path | None
) -> tuple[dict[str, Any], int]:
    """Figures and exit code of a run that goes on.

    Raises:
        ConfigError: a setting or the data set differs from that of the run.
    """
    from offline.data.dataset import load_dataset
    from offline.training.run import load_checkpoint, open_run, rewrite_config

    run = open_run(path)
    checkpoint = load_checkpoint(run.last)
    config = _config_to_resume(run.config, checkpoint.step, chosen)
    folder = data or run.data_folder
    dataset = load_dataset(folder)
    if dataset.sha256 != run.data_sha256:
        raise ConfigError(
            f"--resume: expected the data set {run.data_sha256:.16}… of that run, found "
            f"{dataset.sha256:.16}… in {folder}. Name the right folder with --data."
        )
    return _run(rewrite_config(run, config), dataset, checkpoint=checkpoint)


def _config_to_resume(
    before: TrainingConfig, steps_done: int, chosen: TrainingConfig | None
) -> TrainingConfig:
    explicit = explicit_fields(chosen)
    foreign = sorted(set(explicit) - RESUMABLE_SETTINGS)
    if foreign:
        raise ConfigError(
            f"--resume: expected no other setting than --steps and --threads, found "
            f"{', '.join(foreign)}. Start a new run to change them."
        )
    steps = explicit.get("steps", before.steps)
    if steps != before.steps and before.rate_schedule == "cosine":
        raise ConfigError(
            f"--resume --steps {steps}: expected {before.steps}, the length of this run's learning "
            f"rate schedule. Start a new run to train for another number of steps."
        )
    if steps != before.steps and steps < steps_done:
        raise ConfigError(
            f"--resume --steps {steps}: expected at least the {steps_done} steps that are done. "
            f"Export the run as it is, or start a new one."
        )
    return before.model_copy(update=explicit)


def _run(
    run: "RunFolder",
    dataset: "Dataset",
    *,
    first_model: "Bundle | None" = None,
    checkpoint: "Checkpoint | None" = None,
) -> tuple[dict[str, Any], int]:
    """Figures, and the exit code: 0 at the last step, 130 if stopped before."""
    from offline.data.manifest import Imported
    from offline.training.run import training_lock
    from offline.training.train import train as run_algorithm

    STDERR.print(f"run {run.path}\ndata {run.data_folder}", soft_wrap=True)
    first_step = checkpoint.step if checkpoint else 0
    begun, shown_s = time.monotonic(), 0.0
    with (
        training_lock(run),
        progress_bar("training", run.config.steps, first_step) as show,
        stop_on_signals() as stop_requested,
    ):

        def on_progress(state: "TrainingState") -> None:
            nonlocal shown_s
            now_s = time.monotonic()
            if now_s - shown_s >= REFRESH_S or state.step == run.config.steps:
                shown_s = now_s
                show(state.step, _to_text(state))

        result = run_algorithm(
            run.config,
            dataset,
            run,
            first_model=first_model,
            resume_from=checkpoint,
            on_progress=on_progress,
            stop_requested=stop_requested,
        )
    wall_s = time.monotonic() - begun
    figures = {
        "run": str(run.path),
        "is_finished": result.is_finished,
        "step": result.step,
        "best_validation_loss": result.best_validation_loss,
        "skipped_steps": result.skipped,
        "wall_s": wall_s,
        "steps_per_s": (result.step - first_step) / max(wall_s, 1e-9),
    }
    if not result.is_finished:
        print_plain(
            f"Stopped after step {result.step} of {run.config.steps}; a checkpoint was written. "
            f"Continue with:\n  offline-train --resume {quoted(run.path)}"
        )
        return figures, INTERRUPTED
    name = f" --name {quoted(run.data_folder.name)}" if isinstance(dataset.origin, Imported) else ""
    early = "" if result.step >= run.config.steps else ", because the learning rate is too low"
    print_plain(
        f"Done after {result.step} steps in {wall_s:.0f} s{early}; best validation loss "
        f"{result.best_validation_loss:.4f}. Next:\n  offline-export {quoted(run.path)}{name}"
    )
    return figures, 0


def _to_text(state: "TrainingState") -> str:
    losses = state.losses
    return (
        f"loss {losses.total.item():.4f}: single step {losses.single_step.item():.4f}, "
        f"multi step {losses.multi_step.item():.4f} (states {losses.states.item():.4f}), "
        f"stability {losses.stability.item():.1e}, "
        f"regularisation {losses.regularisation.item():.4g}\n"
        f"validation {state.validation_losses[-1]:.4f}, best {state.best_validation_loss:.4f}, "
        f"spectral radius {state.spectral_radius:.4f}, rate {state.optimizer.rate:.1e}"
    )
