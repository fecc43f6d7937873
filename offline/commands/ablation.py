"""The work of `offline-ablate`: train the variants, write the table, print the summary.

All figures are of the validation part; the test part is for the model that is finally chosen.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from offline.commands.dataset import open_campaign_data
from offline.commands.terminal import STDERR, STDOUT, progress_bar
from offline.config import TrainingConfig
from offline.experiments.backend import Backend
from offline.experiments.comparison import (
    Row,
    compare,
    comparison_figures,
    comparison_markdown,
    read_variants,
)
from offline.experiments.settings import common_fields
from offline.files import write_json
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.files import write_text

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
) -> dict[str, Any]:
    """Figures of `offline-ablate`."""
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
            lambda done, row: show(done, _result_line(row)),
        )
    figures = {
        "list": name,
        "folder": str(folder),
        "data_sha256": shared.sha256,
        "seeds": list(numbers),
        **comparison_figures(title, shared, rows),
    }
    try:
        write_text(folder / TABLE_FILE, comparison_markdown(figures))
        write_json(folder / FIGURES_FILE, figures)
    except OSError as error:
        raise ConfigError(
            f"--folder {folder}: expected room for the table, found: {error.strerror}. The "
            f"trainings are done: free some space and run the command again."
        ) from error
    for row in rows:
        if row.result.ratios is None:
            STDOUT.print(_result_line(row), soft_wrap=True, markup=False)
    STDOUT.print(f"{name}: {folder / TABLE_FILE}", soft_wrap=True, markup=False)
    return figures


def parse_seeds(text: str) -> tuple[int, ...]:
    """Integers of a comma-separated list, each once, in their order.

    Raises:
        ConfigError: a part is no integer.
    """
    try:
        return tuple(dict.fromkeys(int(part) for part in text.split(",")))
    except ValueError as error:
        raise ConfigError(f"--seeds: expected numbers like 0,1,2, found {text!r}.") from error


def _result_line(row: Row) -> str:
    result, name = row.result, f"{row.variant.name}, seed {row.seed}"
    if result.ratios is None:
        return f"{name}: {result.ending}: {result.reason}"
    return (
        f"{name}: {result.ratios.geometric_mean:.2f} times better than the fair linear model, "
        f"{result.training_cpu_s:.0f} s of CPU time"
    )
