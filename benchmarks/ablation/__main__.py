"""`python -m benchmarks.ablation`: variants of a model, trained on the same data and compared.

All figures are of the validation part; the test part is for the model that is finally chosen.
"""

import json as json_module
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any, NamedTuple

import cyclopts

from benchmarks.ablation.training import (
    Result,
    SharedData,
    geometric_mean,
    measure_linear_model,
    run_training,
)
from benchmarks.ablation.variants import SHIPPED_FILE, Training, read_variants
from offline.commands.dataset import config_of_data, ensure_dataset
from offline.commands.options import RUNS, Config, DataFolder, JsonFile, Several
from offline.commands.terminal import STDERR, STDOUT, progress_bar
from offline.config import explicit_fields
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import require_folder, require_writable, write_figures
from rt_controller.report.table import NO_VALUE, Column, Table, format_number, to_markdown
from rt_controller.terminal.command_line import run_command
from sim_bridge.campaign import THIS_MACHINE, Backend, digest, run_campaign

OF_DATA = ("episodes", "data_seed", "largest_steer_deg")
"""fields of a configuration that follow from the data set"""
INSTEAD = {"preset": "the name of the list", "seed": "--seeds"}

app = cyclopts.App(name="python -m benchmarks.ablation", version_flags=[])


class Row(NamedTuple):
    """A training and how it ended."""

    training: Training
    result: Result


@app.default
def main(
    variants: str = "ladder",
    *,
    config: Config = None,
    seeds: Annotated[tuple[int, ...], Several] = (0,),
    only: Annotated[tuple[str, ...], Several] = (),
    lists: Path = SHIPPED_FILE,
    folder: Path | None = None,
    data: DataFolder = None,
    backend: Backend = THIS_MACHINE,
    json: JsonFile = None,
) -> None:
    """Train every variant with every seed, and compare each with a linear model.

    Ctrl-C stops; the same command goes on with the trainings that have not ended. Options of
    offline-train, such as --steps, apply to all variants.

    Args:
        variants: a list of the file: ladder, leave-one-out, paper-readings; or a preset, as a list
            of one.
        config: options of offline-train.
        seeds: of every variant.
        only: names of variants; default: the whole list.
        lists: TOML file with lists of variants.
        folder: of the trainings and their results; default: runs/ablation-LIST.
    """
    require_writable(json)
    common = explicit_fields(config)
    for name in INSTEAD.keys() & common.keys():
        found = common[name]
        raise ConfigError(f"--{name}: expected {INSTEAD[name]} in its place, found {found!r}.")
    # There are as many trainings as cores: a second thread would wait for another training.
    title, chosen = read_variants(variants, lists, {"threads": 1, **common}, only)
    folder = (folder or RUNS / f"ablation-{variants}").resolve()
    require_folder(folder, "--folder")
    folder.mkdir(parents=True, exist_ok=True)
    data_folder, dataset = ensure_dataset(data, chosen[0].config, backend)
    of_data = config_of_data(data_folder, dataset.origin, chosen[0].config, config)
    with STDERR.status("fair linear model"):
        shared = measure_linear_model(data_folder, dataset)
    numbers = list(dict.fromkeys(seeds))
    fields = {name: getattr(of_data, name) for name in OF_DATA}
    trainings = [
        each._replace(config=each.config.model_copy(update={**fields, "seed": seed}))
        for each in chosen
        for seed in numbers
    ]
    STDERR.print(f"{title}\nfolder {folder}\ndata {shared.folder}", soft_wrap=True, markup=False)
    rows = run_all(trainings, shared, folder, backend)
    figures = {
        "list": variants,
        "folder": str(folder),
        "data_sha256": shared.sha256,
        "seeds": numbers,
        **figures_of(title, shared, rows),
    }
    write_figures(json, figures)
    STDOUT.print(markdown_of(figures), soft_wrap=True, markup=False, highlight=False)


def run_all(
    trainings: Sequence[Training], data: SharedData, folder: Path, backend: Backend
) -> list[Row]:
    """A row for each training, in this order; trainings that have ended are not repeated.

    Raises:
        ConfigError: the folder has trainings with other data.
        WorkersLostError: a worker died.
    """
    keys = [f"{each.folder} {_digest_of(each):.16}" for each in trainings]
    arguments = [(folder / each.folder, each.config, data) for each in trainings]
    tasks = dict(zip(keys, arguments, strict=True))
    made_with = {"data_sha256": data.sha256}
    file, found = folder / "results.jsonl", dict[str, Result]()
    with progress_bar("trainings", len(tasks)) as show:
        for key, fields in run_campaign(run_training, tasks.items(), backend, file, made_with):
            found[key] = Result(**fields)
            show(len(tasks.keys() & found), f"{key}: {found[key].ending} {found[key].reason}")
    return [Row(each, found[key]) for key, each in zip(keys, trainings, strict=True)]


def _digest_of(training: Training) -> str:
    return digest(training.config.model_dump(mode="json", exclude={"threads"}))


def figures_of(title: str, data: SharedData, rows: Sequence[Row]) -> dict[str, Any]:
    """The figures for `--json`; those of a variant are pooled over its seeds.

    A ratio is that of the mean squared errors of the fair linear model to those of the variant.
    """
    variants = []
    for variant, group in groupby(rows, key=lambda row: row.training.variant):
        seeds = list(group)
        config, models = seeds[0].training.config, [r.result for r in seeds if r.result.mse_ratio]
        ratios = [model.mse_ratio or {} for model in models]
        means = [geometric_mean(each.values()) for each in ratios]
        names = ratios[0] if ratios else ()
        by_state = {name: geometric_mean(each[name] for each in ratios) for name in names}
        variants.append(
            {
                **variant.model_dump(),
                "n_steps": config.steps,
                "n_trajectories_per_step": config.batch,
                "n_parameters": models[0].n_parameters if models else None,
                "geometric_mean_ratio": geometric_mean(means) if means else None,
                "least_geometric_mean_ratio": min(means, default=None),
                "most_geometric_mean_ratio": max(means, default=None),
                "mse_ratio": by_state or None,
                "training_cpu_s": fmean(m.training_cpu_s for m in models) if models else None,
                "trainings": [{"seed": r.training.config.seed, **asdict(r.result)} for r in seeds],
            }
        )
    return {"title": title, "baseline_mse_si": dict(data.linear_mse), "variants": variants}


def markdown_of(figures: Mapping[str, Any]) -> str:
    """Two tables: the ratios of the variants, pooled over the seeds, and those of each training."""
    variants, states = figures["variants"], figures["baseline_mse_si"]
    trainings = [{"name": v["name"], **each} for v in variants for each in v["trainings"]]
    mean, cost = "geometric_mean_ratio", "training_cpu_s"
    pooled = ("name", "changes", mean, f"least_{mean}", f"most_{mean}", *states, "n_parameters")
    single = ("name", "seed", "ending", *states, mean, "spectral_radius", "step", cost)
    title = (
        f"# {figures['title']}\n\nMean squared error of the fair linear model over that of the "
        f"variant, on the validation part: more is better."
    )
    return "\n\n".join((title, _table(pooled, variants), _table(single, trainings)))


def _table(keys: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> str:
    """A column for each key of the rows or of their ratios."""
    cells = [{**row, **(row["mse_ratio"] or {})} for row in rows]
    texts = (tuple(_text(each.get(key)) for key in keys) for each in cells)
    return to_markdown(Table("", tuple(map(Column, keys)), tuple(texts)))


def _text(value: float | str | Mapping[str, Any] | None) -> str:
    if not value and not isinstance(value, float | int):
        return NO_VALUE
    if isinstance(value, Mapping):
        changes = (f"`{name} = {json_module.dumps(to)}`" for name, to in value.items())
        return ", ".join(changes)
    return format_number(value) if isinstance(value, float) else str(value)


if __name__ == "__main__":
    run_command(app)
