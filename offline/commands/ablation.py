"""The work of `offline-ablate`: train the variants, write the table, print the summary.

All figures are of the validation part; the test part is for the model that is finally chosen.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from offline.commands.dataset import open_campaign_data
from offline.commands.terminal import STDERR, STDOUT, progress_bar
from offline.config import TrainingConfig
from offline.experiments.ablation import compare
from offline.experiments.backend import Backend
from offline.experiments.settings import common_fields
from offline.experiments.table import Row, comparison_figures, comparison_markdown, pool_seeds
from offline.experiments.training_task import Result
from offline.experiments.variants import read_variants
from offline.files import write_json
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import write_text
from rt_controller.terminal.entry import INTERRUPTED

TABLE_FILE = "table.md"
FIGURES_FILE = "table.json"
NO_OPTIONS = {"preset": "the name of the list", "seed": "--seeds"}


def ablate(
    name: str,
    seeds: str,
    only: str,
    lists: Path | None,
    common: TrainingConfig | None,
    folder: Path,
    data: Path | None,
    backend: Backend,
) -> tuple[dict[str, Any], int]:
    """Figures and exit code of `offline-ablate`: 0 with a complete table, 130 if stopped."""
    numbers = parse_seeds(seeds)
    names = [part.strip() for part in only.split(",") if part.strip()]
    title, chosen = read_variants(name, lists, common_fields(common, NO_OPTIONS), names)
    width = max(len(variant.name) for variant in chosen)
    lines = [f"  {variant.name:<{width}}  {variant.why}" for variant in chosen]
    STDERR.print("\n".join((title, *lines)), soft_wrap=True, markup=False, highlight=False)
    shared, configs = open_campaign_data(
        data, [variant.config for variant in chosen], common, backend
    )
    pairs = zip(chosen, configs, strict=True)
    variants = [replace(variant, config=config) for variant, config in pairs]
    STDERR.print(f"campaign {folder}\ndata {shared.folder}", soft_wrap=True)
    total = len(variants) * len(numbers)
    with progress_bar("trainings", total) as show:
        rows = compare(
            variants,
            numbers,
            shared,
            folder,
            backend,
            lambda done, row, result: show(done, _result_line(row, result)),
        )
    n_open = sum(row.result is None for row in rows)
    results = pool_seeds(rows)
    figures = {
        "list": name,
        "folder": str(folder),
        "data_sha256": shared.sha256,
        "seeds": list(numbers),
        "is_finished": not n_open,
        **comparison_figures(title, shared, results),
    }
    try:
        write_text(folder / TABLE_FILE, comparison_markdown(title, shared, results))
        write_json(folder / FIGURES_FILE, figures)
    except OSError as error:
        raise ConfigError(
            f"--folder {folder}: expected room for the table, found: {error.strerror}. The "
            f"trainings are done: free some space and run the command again."
        ) from error
    if n_open:
        STDOUT.print(
            f"Stopped with {n_open} trainings to go; nothing is lost. Run the same command again "
            f"to continue.",
            soft_wrap=True,
        )
        return figures, INTERRUPTED
    for row in rows:
        if row.result is not None and row.result.ratios is None:
            STDOUT.print(_result_line(row, row.result), soft_wrap=True, markup=False)
    STDOUT.print(f"{name}: {folder / TABLE_FILE}", soft_wrap=True, markup=False)
    return figures, 0


def parse_seeds(text: str) -> tuple[int, ...]:
    """Integers of a comma-separated list, each once, in their order.

    Raises:
        ConfigError: a part is no integer.
    """
    try:
        return tuple(dict.fromkeys(int(part) for part in text.split(",")))
    except ValueError as error:
        raise ConfigError(f"--seeds: expected numbers like 0,1,2, found {text!r}.") from error


def _result_line(row: Row, result: Result) -> str:
    name = f"{row.variant.name}, seed {row.seed}"
    if result.ratios is None:
        return f"{name}: {result.ending}: {result.reason}"
    return (
        f"{name}: {result.ratios.geometric_mean:.2f} times better than the fair linear model, "
        f"{result.training_cpu_s:.0f} s of CPU time"
    )
