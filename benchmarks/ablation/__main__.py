"""`offline-ablate`: train the variants, write the table, print the summary.

All figures are of the validation part; the test part is for the model that is finally chosen.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from offline.commands.options import (
    RUNS,
    THIS_MACHINE,
    Config,
    DataFolder,
    JsonFile,
    require_ready,
)
from offline.commands.terminal import STDERR, STDOUT, progress_bar
from offline.experiments.backend import Backend
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import write_figures

if TYPE_CHECKING:
    from offline.experiments.comparison import Row


def ablate(
    variants: str = "ladder",
    *,
    config: Config = None,
    seeds: str = "0",
    only: str = "",
    lists: Path | None = None,
    folder: Path | None = None,
    data: DataFolder = None,
    backend: Backend = THIS_MACHINE,
    json_file: JsonFile = None,
) -> None:
    """Train every variant with every seed, and compare each with a linear model.

    Ctrl-C stops; the same command goes on with the trainings that have not ended. Options of
    offline-train, such as --steps, apply to all variants. docs/experiments.md describes the file of
    variants.

    Args:
        variants: a list of the file: ladder, leave-one-out, sizes, paper-readings; or a preset, as
            a list of one
        seeds: seeds of every variant, such as 0,1,2
        only: names of variants, such as paper,history; default: the whole list
        lists: TOML file with lists of variants; default: the shipped one
        folder: folder of the campaign; default: runs/ablation-LIST
    """
    require_ready(json_file)
    from offline.commands.dataset import open_campaign_data
    from offline.experiments import comparison
    from offline.experiments.settings import common_fields
    from offline.files import write_json
    from rt_controller.contract.files import write_text

    try:
        numbers = list(dict.fromkeys(int(part) for part in seeds.split(",")))
    except ValueError as error:
        raise ConfigError(f"--seeds: expected numbers like 0,1,2, found {seeds!r}.") from error
    names = [part.strip() for part in only.split(",") if part.strip()]
    common = common_fields(config, {"preset": "the name of the list", "seed": "--seeds"})
    title, chosen = comparison.read_variants(variants, lists, common, names)
    lines = [title, *(f"  {each.variant.name:<20}  {each.variant.why}" for each in chosen)]
    campaign = folder or RUNS / f"ablation-{variants}"
    shared, of_data = open_campaign_data(data, chosen[0].config, config, backend)
    lines += [f"campaign {campaign}", f"data {shared.folder}"]
    STDERR.print("\n".join(lines), soft_wrap=True, markup=False, highlight=False)
    trainings = [
        each._replace(config=each.config.model_copy(update={**of_data, "seed": seed}))
        for each in chosen
        for seed in numbers
    ]
    with progress_bar("trainings", len(trainings)) as show:
        rows = comparison.compare(
            trainings, shared, campaign, backend, lambda done, row: show(done, _to_text(row))
        )
    figures = {
        "list": variants,
        "folder": str(campaign),
        "data_sha256": shared.sha256,
        "seeds": numbers,
        **comparison.comparison_figures(title, shared, rows),
    }
    write_text(campaign / "table.md", comparison.comparison_markdown(figures))
    write_json(campaign / "table.json", figures)
    write_figures(json_file, figures)
    lines = [_to_text(row) for row in rows if row.result.mse_ratio is None]
    lines.append(f"{variants}: {campaign / 'table.md'}")
    STDOUT.print("\n".join(lines), soft_wrap=True, markup=False)


def _to_text(row: "Row") -> str:
    name, result = f"{row.training.variant.name}, seed {row.training.config.seed}", row.result
    if result.geometric_mean_ratio is None:
        return f"{name}: {result.ending}: {result.reason}"
    return (
        f"{name}: {result.geometric_mean_ratio:.2f} times better than the fair linear model, "
        f"{result.training_cpu_s:.0f} s of CPU time"
    )
