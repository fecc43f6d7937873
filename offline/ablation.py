"""What `offline-ablate` does: train every variant of a list with every seed, and compare them.

Everything is judged on the validation part. The test part is for the one model that is chosen in
the end.
"""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.markup import escape

from offline.backend import Backend
from offline.campaign.campaign import run_campaign
from offline.campaign.data import CampaignData, open_data
from offline.campaign.settings import explicit_fields
from offline.campaign.table import Row, Table, to_figures, to_markdown
from offline.campaign.trainings import Result, Training
from offline.campaign.variants import VariantList, read_variants
from offline.config import TrainingConfig
from offline.interrupt import INTERRUPTED
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
    """Exit code of `offline-ablate`: 0 with a whole table, 130 where it was stopped before."""
    variants = read_variants(
        question.variants,
        question.file,
        explicit_fields(question.common, GIVEN_OTHERWISE),
        question.only,
    )
    there = open_data(data, variants.variants[0].config, question.common, backend)
    begun = [
        (variant, seed, _training(folder, variant.name, variant.config, seed, there))
        for variant in variants.variants
        for seed in question.seeds
    ]
    CONSOLE.print(f"campaign {folder}\ndata {there.folder}", soft_wrap=True)
    results = _run(folder, [training for _, _, training in begun], backend)
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
    return _say(folder, variants, table, len(begun) - len(results))


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


def _run(folder: Path, trainings: Sequence[Training], backend: Backend) -> dict[int, Result]:
    with progress_bar("trainings", len(trainings)) as show:
        ended = 0

        def on_end(number: int, result: Result) -> None:
            nonlocal ended
            ended += 1
            place = trainings[number].folder.relative_to(folder.resolve())
            show(ended, f"{place}: {describe(result)}")

        return run_campaign(folder, trainings, backend, on_end)


def describe(result: Result) -> str:
    """A result in one line."""
    if result.score is None:
        return f"{result.ending}: {result.reason}"
    return (
        f"{result.score.geometric_mean:.2f} times better than the fair linear model, "
        f"{result.training_s:.0f} s"
    )


def _write(folder: Path, table: Table, figures: dict[str, Any]) -> None:
    try:
        for name, text in (
            (TABLE_FILE, to_markdown(table)),
            (FIGURES_FILE, json.dumps(figures, indent=2) + "\n"),
        ):
            part = folder / f".{name}.{os.getpid()}.part"  # two commands may share the folder
            part.write_text(text, encoding="utf-8")
            os.replace(part, folder / name)
    except OSError as error:
        raise ConfigError(
            f"--folder {folder}: expected room for the table, found: {error.strerror}. The "
            f"trainings are done: free some space and run the command again."
        ) from error


def _say(folder: Path, variants: VariantList, table: Table, open_trainings: int) -> int:
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
            CONSOLE.print(f"{row.variant.name}, seed {row.seed}: {escape(describe(result))}")
    CONSOLE.print(f"{escape(variants.name)}: {folder / TABLE_FILE}", soft_wrap=True)
    return 0
