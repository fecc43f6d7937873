"""A training run at the terminal: a bar, a way to stop it, and what it says at its end."""

import time
from pathlib import Path

from offline.checkpoint import Checkpoint
from offline.dataset import Dataset
from offline.interrupt import INTERRUPTED, stop_on_signals
from offline.run_folder import RunFolder
from offline.terminal import CONSOLE, progress_bar
from offline.train import Outcome, Progress, train
from rt_controller.contract.figures import write_figures

REFRESH_S = 0.25


def run_training(
    run: RunFolder, dataset: Dataset, checkpoint: Checkpoint | None, json_file: Path | None
) -> int:
    """Exit code: 0 at the last step, 130 where the run was asked to stop before."""
    CONSOLE.print(f"run {run.path}\ndata {run.data_folder}", soft_wrap=True)
    first_step = checkpoint.step if checkpoint else 0
    begun = time.monotonic()
    outcome = _watch(run, dataset, checkpoint, first_step)
    wall_s = time.monotonic() - begun
    write_figures(
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
            f"Stopped after step {outcome.step} of {run.config.steps}; nothing is lost. Go on "
            f"with:\n  offline-train --resume {run.path}",
            soft_wrap=True,
        )
        return INTERRUPTED
    early = "" if outcome.step >= run.config.steps else ", since the rate became too low to learn"
    CONSOLE.print(
        f"Done after {outcome.step} steps in {wall_s:.0f} s{early}; best validation loss "
        f"{outcome.best_validation_loss:.4f}. Next:\n  offline-export {run.path}",
        soft_wrap=True,
    )
    return 0


def _watch(
    run: RunFolder, dataset: Dataset, checkpoint: Checkpoint | None, first_step: int
) -> Outcome:
    """The outcome of the run, after showing how it goes."""
    with (
        progress_bar("training", run.config.steps, first_step) as show,
        stop_on_signals() as stop_requested,
    ):
        shown = 0.0

        def on_progress(progress: Progress) -> None:
            nonlocal shown
            now = time.monotonic()
            if now - shown >= REFRESH_S or progress.step == run.config.steps:
                shown = now
                show(progress.step, _describe(progress))

        return train(
            run.config,
            dataset,
            run,
            resume_from=checkpoint,
            on_progress=on_progress,
            stop_requested=stop_requested,
        )


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
