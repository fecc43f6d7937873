"""What the offline commands do: load, work, print, write.

Everything heavy is imported here, so only `offline.cli` imports this room, and late.
"""

import time
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from offline.backend import Backend
from offline.baselines import roster
from offline.baselines.bundle import bundle_of
from offline.card import Fact, write_card
from offline.checkpoint import load_checkpoint
from offline.comparison import compare, print_pooled
from offline.config import TrainingConfig, resolve
from offline.dataset import Dataset, exists, load_dataset
from offline.evaluation_figures import pooled_figures
from offline.export import Gate, choose_selftest, make_bundle, pass_gate
from offline.learner import find_device
from offline.lengths import PAST_STEPS
from offline.manifest import Imported, Origin
from offline.revision import source_revision
from offline.rivals import describe_rival, rival_cache
from offline.roles import past_names
from offline.run_folder import create_run, open_run, rewrite_config
from offline.stock import ensure_dataset, full_folder
from offline.terminal import CONSOLE
from offline.training_run import run_training
from rt_controller.contract.artifact import Bundle, Lift, save_bundle
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.contract.figures import write_figures
from rt_controller.contract.fitness import find_objection_to_driving

RESUMABLE_SETTINGS = {"steps", "threads"}


def make_data(
    episodes: int, seed: int, data: Path | None, backend: Backend, json_file: Path | None
) -> int:
    """Exit code of `offline-data`."""
    begun = time.monotonic()
    folder, dataset = ensure_dataset(data, episodes, seed, backend)
    wall_s = time.monotonic() - begun
    _require_origin(folder, dataset.origin, episodes, seed)
    manifest = dataset.manifest
    CONSOLE.print(
        f"{manifest.trajectories} trajectories of {episodes} episodes, "
        f"{100 * manifest.rejected_fraction:.1f} % of the tries rejected, "
        f"SHA-256 {dataset.sha256:.16}…, {wall_s:.1f} s\n{folder}",
        soft_wrap=True,
    )
    write_figures(
        json_file,
        {
            "folder": str(folder),
            "n_episodes": episodes,
            "n_trajectories": manifest.trajectories,
            "rejected_fraction": manifest.rejected_fraction,
            "sha256": dataset.sha256,
            "wall_s": wall_s,
        },
    )
    return 0


def train_model(
    chosen: TrainingConfig | None,
    runs: Path,
    data: Path | None,
    backend: Backend,
    json_file: Path | None,
) -> int:
    """Exit code of `offline-train`: a new run."""
    config = resolve(chosen)
    find_device(config.device)
    folder, dataset = ensure_dataset(data, config.episodes, config.data_seed, backend)
    config = _config_of_data(folder, dataset.origin, config, chosen)
    run = create_run(runs, config, folder, dataset.sha256, datetime.now())
    return run_training(run, dataset, None, json_file)


def resume_training(
    path: Path, chosen: TrainingConfig | None, data: Path | None, json_file: Path | None
) -> int:
    """Exit code of `offline-train --resume`: an old run goes on."""
    run = open_run(path)
    checkpoint = load_checkpoint(run.last)
    config = _config_to_resume(run.config, checkpoint.step, chosen)
    dataset = load_dataset(data or run.data_folder)
    if dataset.sha256 != run.data_sha256:
        raise ConfigError(
            f"--resume: expected the data set {run.data_sha256:.16}… of that run, found "
            f"{dataset.sha256:.16}… in {data or run.data_folder}. Name the right folder with "
            f"--data."
        )
    return run_training(rewrite_config(run, config), dataset, checkpoint, json_file)


def export_run(path: Path, output: Path | None, data: Path | None, json_file: Path | None) -> int:
    """Exit code of `offline-export`: the best model of a run."""
    run = open_run(path)
    checkpoint = load_checkpoint(run.best)
    dataset = load_dataset(data or run.data_folder)
    bundle, gate = make_bundle(checkpoint, dataset)
    facts = [
        Fact("preset", checkpoint.config.preset),
        Fact(
            "steps",
            f"{load_checkpoint(run.last).step} of {run.config.steps} trained; this model is "
            f"the best of them, after step {checkpoint.step}",
        ),
        # A checkpoint is kept right after its evaluation.
        Fact("validation loss", f"{checkpoint.validation_losses[-1]:.5f}"),
        Fact("seed", str(checkpoint.config.seed)),
        Fact("revision, trained", run.revision),
        *(Fact(f"version of {name}", number) for name, number in run.versions.items()),
    ]
    return _deliver(bundle, gate, facts, dataset, output or run.bundle, json_file)


def export_rival(
    name: str, data: Path | None, output: Path, run: Path, json_file: Path | None
) -> int:
    """Exit code of `offline-export --rival`: a rival fitted to a data set."""
    if not roster.is_drivable(name):
        raise ConfigError(
            f"--rival {name}: expected a model that is linear, or bilinear, in what it lifts, so "
            f"that a convex QP can plan with it, found another kind. Take one of "
            f"{', '.join(each for each in roster.names() if roster.is_drivable(each))}."
        )
    full = full_folder()
    folder = data or (full if exists(full) else open_run(run).data_folder)
    CONSOLE.print(f"data {folder}", soft_wrap=True)
    dataset = load_dataset(folder)
    whole_past = Lift(("x", "w", "history"), PAST_STEPS, past_names(dataset.schema, dataset.roles))
    with CONSOLE.status(f"rival {name}"):
        rival = roster.fit(name, dataset, rival_cache())
    bundle = bundle_of(name, rival, dataset, choose_selftest(dataset, whole_past))
    facts = [Fact(what, found) for what, found in describe_rival(name, dataset)]
    return _deliver(bundle, pass_gate(bundle), facts, dataset, output, json_file)


def _deliver(
    bundle: Bundle,
    gate: Gate,
    facts: Sequence[Fact],
    dataset: Dataset,
    target: Path,
    json_file: Path | None,
) -> int:
    """Judge a bundle, write it with its card, and say how to drive with it."""
    revision = source_revision()
    origin = dataset.origin
    data = (
        f"{origin.episodes} episodes, {dataset.manifest.trajectories} trajectories, "
        f"seed {origin.seed}"
    )
    facts = [*facts, Fact("revision, exported", revision), Fact("data set", data)]
    evaluation = compare(bundle, dataset)
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
    print_pooled(evaluation)
    objection = find_objection_to_driving(bundle)
    CONSOLE.print(
        f"Drive with it:\n  rt-controller --bus virtual --model {target}"
        if objection is None
        else objection,
        soft_wrap=True,
    )
    write_figures(
        json_file,
        {
            "bundle": str(target),
            "model": bundle.name,
            "model_sha256": bundle.sha256,
            "revision": revision,
            "spectral_radius": gate.spectral_radius,
            "growth_20": gate.growth_20,
            "growth_80": gate.growth_80,
            "parity": gate.parity,
            "size_bytes": sum(file.stat().st_size for file in target.iterdir()),
            **pooled_figures(evaluation),
        },
    )
    return 0


def _require_origin(folder: Path, origin: Origin, episodes: int, seed: int) -> None:
    if isinstance(origin, Imported):
        return  # logs are as many as they are
    if (origin.episodes, origin.seed) != (episodes, seed):
        raise DatasetError(
            f"{folder}: expected {episodes} episodes of seed {seed}, found a data set of "
            f"{origin.episodes} episodes of seed {origin.seed}. Choose another --data."
        )


def _config_of_data(
    folder: Path, origin: Origin, config: TrainingConfig, chosen: TrainingConfig | None
) -> TrainingConfig:
    """The configuration with the episodes and the seed of the data that are there.

    Raises:
        DatasetError: others were explicitly asked for.
    """
    explicit = chosen.model_fields_set if chosen else set()
    _require_origin(
        folder,
        origin,
        config.episodes if "episodes" in explicit else origin.episodes,
        config.data_seed if "data_seed" in explicit else origin.seed,
    )
    return config.model_copy(update={"episodes": origin.episodes, "data_seed": origin.seed})


def _config_to_resume(
    before: TrainingConfig, steps_done: int, chosen: TrainingConfig | None
) -> TrainingConfig:
    if chosen is None:
        return before
    foreign = sorted(chosen.model_fields_set - RESUMABLE_SETTINGS)
    if foreign:
        raise ConfigError(
            f"--resume: expected no other setting than --steps and --threads, found "
            f"{', '.join(foreign)}. Start a new run to change them."
        )
    asks_for_steps = "steps" in chosen.model_fields_set and chosen.steps != before.steps
    if asks_for_steps and before.rate_schedule == "cosine":
        raise ConfigError(
            f"--resume --steps {chosen.steps}: expected the {before.steps} steps that the rate of "
            f"this run falls over. Start a new run to train for another number."
        )
    if asks_for_steps and chosen.steps < steps_done:
        raise ConfigError(
            f"--resume --steps {chosen.steps}: expected no fewer than the {steps_done} steps that "
            f"are done. Export the run as it is, or start a new one."
        )
    explicit = {name: getattr(chosen, name) for name in chosen.model_fields_set}
    return before.model_copy(update=explicit)
