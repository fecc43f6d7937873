"""What `offline-ablate` does: train every variant of a list with every seed, and compare them.

Everything is judged on the validation part. The test part is for the one model that is chosen in
the end.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from offline.backend import Backend
from offline.campaign.attempt import attempt
from offline.campaign.data import CampaignData, open_data
from offline.campaign.result import Result
from offline.campaign.settings import explicit_fields
from offline.campaign.table import Row, Table, to_figures, to_markdown
from offline.campaign.trainings import Training, find_run, run_training
from offline.campaign.variants import VariantList, read_variants
from offline.campaign.whole_file import write_json, write_whole
from offline.config import TrainingConfig
from offline.interrupt import INTERRUPTED
from offline.parallel import as_done
from offline.terminal import CONSOLE, progress_bar
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import write_figures

TABLE_FILE = "table.md"
FIGURES_FILE = "table.json"
GIVEN_OTHERWISE = {"preset": "the name of the list", "seed": "--seeds"}


@dataclass(frozen=True, slots=True)
class Question:
    """What is to be compared."""

    variants: str
    """name of a list, or of a preset"""
    seeds: tuple[int, ...]
    only: tuple[str, ...]
    file: Path | None
    """with lists of one's own; None: the one that ships"""
    common: TrainingConfig | None
    """settings that all variants get on top of their own"""


def ablate(
    question: Question, folder: Path, data: Path | None, backend: Backend, json_file: Path | None
) -> int:
    """Exit code of `offline-ablate`: 0 with a whole table, 130 where it was stopped before.

    Raises:
        ConfigError: the question makes no sense, or the folder holds the answer to another one.
        DatasetError: the data set is none, or not the one that was asked for.
        WorkersLostError: workers died again and again.
    """
    variants = read_variants(
        question.variants,
        question.file,
        explicit_fields(question.common, GIVEN_OTHERWISE),
        question.only,
    )
    _introduce(variants)
    there = open_data(data, variants.variants[0].config, question.common, backend)
    CONSOLE.print(f"campaign {folder}\ndata {there.folder}", soft_wrap=True)
    begun = [
        (variant, seed, _training(folder, variant.name, variant.config, seed, there))
        for variant in variants.variants
        for seed in question.seeds
    ]
    results = _train_all(folder, [training for _, _, training in begun], backend)
    table = Table(
        title=f"{variants.name}: {variants.why}",
        states=there.states,
        rival=there.rivals,
        rows=tuple(
            Row(variant, seed, results.get(number))
            for number, (variant, seed, _) in enumerate(begun)
        ),
    )
    figures = {
        "list": variants.name,
        "folder": str(folder),
        "data_sha256": there.sha256,
        "seeds": list(question.seeds),
        "is_finished": len(results) == len(begun),
        **to_figures(table),
    }
    _write(folder, table, figures)
    write_figures(json_file, figures)
    return _say(folder, variants.name, table, len(begun) - len(results))


def parse_seeds(text: str) -> tuple[int, ...]:
    """Seeds of a comma-separated list, each once, in that order.

    Raises:
        ConfigError: it is none.
    """
    try:
        seeds = tuple(dict.fromkeys(int(part) for part in text.split(",")))
    except ValueError as error:
        raise ConfigError(f"--seeds: expected numbers like 0,1,2, found {text!r}.") from error
    return seeds


def parse_names(text: str) -> tuple[str, ...]:
    """Names of a comma-separated list; none of an empty one."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _introduce(variants: VariantList) -> None:
    CONSOLE.print(f"{variants.name}: {variants.why}", soft_wrap=True, markup=False)
    width = max(len(variant.name) for variant in variants.variants)
    for variant in variants.variants:
        line = f"  {variant.name:<{width}}  {variant.why}"
        CONSOLE.print(line, soft_wrap=True, markup=False, highlight=False)


def _training(
    folder: Path, name: str, config: TrainingConfig, seed: int, there: CampaignData
) -> Training:
    return Training(
        folder=folder.resolve() / name / f"seed-{seed}",
        config=there.configure(config).model_copy(update={"seed": seed}),
        data_folder=there.folder.resolve(),
        data_sha256=there.sha256,
        rivals=there.rivals,
    )


def _train_all(folder: Path, trainings: Sequence[Training], backend: Backend) -> dict[int, Result]:
    """Results by number of the training; those that were stopped before their end are missing.

    What has ended is not done again, what was interrupted goes on from its checkpoint.
    """
    for training in trainings:
        find_run(training)
    results: dict[int, Result] = {}
    with (
        backend.active(),
        attempt(folder) as current,
        progress_bar("trainings", len(trainings)) as show,
    ):
        tasks = [(training, current, os.getpid()) for training in trainings]
        for number, result in as_done(run_training, tasks):
            if result is not None:
                results[number] = result
                place = trainings[number].folder.relative_to(folder.resolve())
                show(len(results), f"{place}: {describe(result)}")
    return results


def describe(result: Result) -> str:
    """A result in one line."""
    if result.score is None:
        return f"{result.ending}: {result.reason}"
    return (
        f"{result.score.geometric_mean:.2f} times better than the fair linear model, "
        f"{result.training_cpu_s:.0f} s of CPU time"
    )


def _write(folder: Path, table: Table, figures: dict[str, Any]) -> None:
    try:
        write_whole(folder / TABLE_FILE, to_markdown(table))
        write_json(folder / FIGURES_FILE, figures)
    except OSError as error:
        raise ConfigError(
            f"--folder {folder}: expected room for the table, found: {error.strerror}. The "
            f"trainings are done: free some space and run the command again."
        ) from error


def _say(folder: Path, name: str, table: Table, open_trainings: int) -> int:
    if open_trainings:
        CONSOLE.print(
            f"Stopped with {open_trainings} trainings to go; nothing is lost. Run the same command "
            f"again to go on.",
            soft_wrap=True,
        )
        return INTERRUPTED
    for row in table.rows:
        result = row.result
        if result is not None and result.score is None:
            line = f"{row.variant.name}, seed {row.seed}: {describe(result)}"
            CONSOLE.print(line, soft_wrap=True, markup=False)
    CONSOLE.print(f"{name}: {folder / TABLE_FILE}", soft_wrap=True, markup=False)
    return 0
