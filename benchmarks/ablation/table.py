"""Comparison of variants of the training configuration, each trained with each seed.

Lists of variants are read from TOML. In a cumulative list a variant also has the changes of those
before it. Variants are comparable only at equal cost: a list may take its budget from another
preset. The results are figures for `--json`, and Markdown of the same figures.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, Field, TypeAdapter

from offline.config import PRESETS, TrainingConfig
from offline.data.generate import run_tasks
from offline.experiments.backend import Backend
from offline.experiments.settings import (
    FolderName,
    Preset,
    changed,
    read_toml,
    require_consistent,
)
from offline.experiments.training_task import (
    CampaignData,
    Result,
    geometric_mean,
    load_result,
    make_folder,
    run_training,
)
from rt_controller.contract.errors import ConfigError
from rt_controller.report.table import NO_VALUE, Column, Table, format_number, to_markdown

SHIPPED = "variants.toml"

BUDGET = ("steps", "batch", "evaluate_every")
"""fields that determine the cost of a training"""


class Variant(BaseModel, frozen=True, extra="forbid"):
    """An entry of a list."""

    name: FolderName
    """also the name of its folder"""
    why: str
    changes: dict[str, Any] = {}
    """its own, without those of the variants before it"""


class _List(BaseModel, extra="forbid"):
    why: str
    base: Preset
    cumulative: bool = False
    budget: Preset | None = None
    common: dict[str, Any] = {}
    variant: Annotated[list[Variant], Field(min_length=1)]


_LISTS = TypeAdapter(dict[FolderName, _List])


class Training(NamedTuple):
    """A variant and its configuration."""

    variant: Variant
    config: TrainingConfig


class Row(NamedTuple):
    """A training and how it ended."""

    training: Training
    result: Result


def read_variants(
    name: str, file: Path | None, common: Mapping[str, Any], only: Sequence[str] = ()
) -> tuple[str, tuple[Training, ...]]:
    """Title and variants of the list of that name; the name of a preset is a list of one.

    `file` None is the shipped file; `common` has the fields that options set for all variants;
    `only` has the names of the variants to keep, empty: all.

    Raises:
        ConfigError: the file, the list, a field or a name is not as expected, or an option would
            change a field that defines a variant.
    """
    lists = read_toml(file, SHIPPED, "--lists", _LISTS)
    if name in PRESETS and name not in lists:
        alone = Variant(name=name, why="the preset alone")
        lists[name] = _List(why="the preset, once for each seed", base=name, variant=[alone])
    if name not in lists:
        known = ", ".join(lists) or "of the file, which has none,"
        raise ConfigError(
            f"variants: expected one of the lists {known} or of the presets "
            f"{', '.join(PRESETS)}, found {name!r}."
        )
    found = lists[name]
    names = [variant.name for variant in found.variant]
    require_consistent(name, names, (), common)
    if unknown := sorted(set(only) - set(names)):
        raise ConfigError(
            f"--only: expected names among {', '.join(names)}, found {', '.join(unknown)}."
        )
    budget = {field: getattr(PRESETS[found.budget or found.base], field) for field in BUDGET}
    base = changed(PRESETS[found.base], {**budget, **found.common}, name)
    trainings, changes = [], dict[str, Any]()
    for variant in found.variant:
        where = f"{name}, variant {variant.name}"
        changes = {**(changes if found.cumulative else {}), **variant.changes}
        config = changed(changed(base, changes, where), common, name)
        if not only or variant.name in only:
            require_consistent(where, (), changes, common)
            trainings.append(Training(variant, config))
    return f"{name}: {found.why}", tuple(trainings)


def compare(
    trainings: Sequence[Training],
    data: CampaignData,
    folder: Path,
    backend: Backend,
    on_result: Callable[[int, Row], None],
) -> list[Row]:
    """A row for each training, in this order; trainings that have ended are not repeated.

    `on_result` is called with the number of ended trainings and the newest one.

    Raises:
        ConfigError: the folder has trainings of other settings, or cannot be written.
        WorkersLostError: a worker died.
    """
    tasks = [
        (folder.resolve() / variant.name / f"seed-{config.seed}", config, data)
        for variant, config in trainings
    ]
    rows: dict[int, Row] = {}
    make_folder(folder)
    for task in tasks:
        load_result(*task)  # refuses other settings before any training
    with backend.active():
        for index, result in run_tasks(run_training, tasks):
            rows[index] = Row(trainings[index], result)
            on_result(len(rows), rows[index])
    return [rows[index] for index in range(len(tasks))]


def comparison_figures(title: str, data: CampaignData, rows: Sequence[Row]) -> dict[str, Any]:
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


def comparison_markdown(figures: Mapping[str, Any]) -> str:
    """Three tables: pooled ratios of the variants, their changes, and all trainings."""
    variants, states = figures["variants"], figures["baseline_mse_si"]
    trainings = [{"name": v["name"], **each} for v in variants for each in v["trainings"]]
    mean, cost = "geometric_mean_ratio", "training_cpu_s"
    pooled = ("name", mean, f"least_{mean}", f"most_{mean}", *states, "n_parameters", cost)
    single = ("name", "seed", "ending", *states, mean, "spectral_radius", "step", cost)
    return "\n\n".join(
        (
            f"# {figures['title']}",
            "Mean squared error over the horizon of the fair linear model, divided by that of the "
            "variant, on the validation part: more is better. The geometric mean is over the "
            "states, and the first table over all seeds.",
            _table(pooled, variants),
            _table(("name", "changes", "why", "n_steps", "n_trajectories_per_step"), variants),
            _table(single, trainings) + "\n",
        )
    )


def _table(keys: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> str:
    """A column for each key of the rows or of their ratios."""
    cells = [{**row, **(row["mse_ratio"] or {})} for row in rows]
    texts = (tuple(_text(each.get(key)) for key in keys) for each in cells)
    return to_markdown(Table("", tuple(map(Column, keys)), tuple(texts)))


def _text(value: float | str | Mapping[str, Any] | None) -> str:
    if not value and not isinstance(value, float | int):
        return NO_VALUE
    if isinstance(value, Mapping):
        return ", ".join(f"`{name} = {json.dumps(to)}`" for name, to in value.items())
    return format_number(value) if isinstance(value, float) else str(value)
