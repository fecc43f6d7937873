"""Comparison of variants of the training configuration, each trained with each seed.

Lists of variants are read from TOML. In a cumulative list a variant also has the changes of those
before it. Variants are comparable only at equal cost: a list may take its budget from another
preset. The results are figures for `--json`, and Markdown of the same figures.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from statistics import fmean, geometric_mean
from typing import Annotated, Any, NamedTuple

from pydantic import BaseModel, Field, TypeAdapter

from offline.config import PRESETS, TrainingConfig
from offline.data.tasks import run_tasks
from offline.experiments.backend import Backend
from offline.experiments.settings import FolderName, Preset, changed, read_toml, require_unique
from offline.experiments.training_task import (
    CampaignData,
    Result,
    Training,
    exclusive_folder,
    load_result,
    run_training,
)
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.settings_errors import option
from rt_controller.report.table import NO_VALUE, Column, Table, to_markdown

SHIPPED = "variants.toml"

BUDGET = ("steps", "batch", "evaluate_every")
"""fields that determine the cost of a training"""


@dataclass(frozen=True, slots=True)
class Variant:
    """One configuration of a list."""

    name: str
    """also the name of its folder"""
    why: str
    changes: Mapping[str, Any]
    """its own changes, without those of the variants before it"""
    config: TrainingConfig


class _Entry(BaseModel, extra="forbid"):
    name: FolderName
    why: str
    changes: dict[str, Any] = {}


class _List(BaseModel, extra="forbid"):
    why: str
    base: Preset
    cumulative: bool = False
    budget: Preset | None = None
    common: dict[str, Any] = {}
    variant: Annotated[list[_Entry], Field(min_length=1)]


_LISTS = TypeAdapter(dict[FolderName, _List])


def read_variants(
    name: str, file: Path | None, common: Mapping[str, Any], only: Sequence[str] = ()
) -> tuple[str, tuple[Variant, ...]]:
    """Title and variants of the list of that name; the name of a preset is a list of one.

    `file` None is the shipped file; `common` has the fields that options set for all variants;
    `only` has the names of the variants to keep, empty: all.

    Raises:
        ConfigError: the file, the list, a field or a name is not as expected, or an option would
            change a field that defines a variant.
    """
    lists = read_toml(file, SHIPPED, "--lists", _LISTS)
    if name in lists:
        entries = lists[name]
    elif name in PRESETS:
        purpose = f"the preset {name}, once for each seed"
        entries = _List(why=purpose, base=name, variant=[_Entry(name=name, why="the preset alone")])
    else:
        known = ", ".join(lists) or "of the file, which has none,"
        raise ConfigError(
            f"variants: expected one of the lists {known} or of the presets "
            f"{', '.join(PRESETS)}, found {name!r}."
        )
    names = [entry.name for entry in entries.variant]
    require_unique(names, name)
    unknown = sorted(set(only) - set(names))
    if unknown:
        raise ConfigError(
            f"--only: expected names among {', '.join(names)}, found {', '.join(unknown)}."
        )
    return f"{name}: {entries.why}", tuple(_resolve(name, entries, common, only or names))


def _resolve(
    name: str, entries: _List, common: Mapping[str, Any], only: Sequence[str]
) -> Iterator[Variant]:
    budget = {field: getattr(PRESETS[entries.budget or entries.base], field) for field in BUDGET}
    base = changed(PRESETS[entries.base], {**budget, **entries.common}, name)
    changes: dict[str, Any] = {}
    for entry in entries.variant:
        where = f"{name}, variant {entry.name}"
        changes = {**(changes if entries.cumulative else {}), **entry.changes}
        config = changed(changed(base, changes, where), common, name)
        if entry.name not in only:
            continue
        if undone := sorted(set(changes) & set(common)):
            raise ConfigError(
                f"{where}: expected no option for a field that this variant sets, found "
                f"{option((undone[0],))}. Leave it out."
            )
        yield Variant(entry.name, entry.why, entry.changes, config)


class Row(NamedTuple):
    """One training of a variant."""

    variant: Variant
    seed: int
    result: Result


def compare(
    variants: Sequence[Variant],
    seeds: Sequence[int],
    data: CampaignData,
    folder: Path,
    backend: Backend,
    on_result: Callable[[int, Row], None],
) -> list[Row]:
    """One row for each variant and seed, in this order; trainings that have ended are not repeated.

    `on_result` is called with the number of ended trainings and the newest one.

    Raises:
        ConfigError: the folder has trainings of other settings, is in use, or cannot be written.
        WorkersLostError: a worker died.
    """
    pairs = [(variant, seed) for variant in variants for seed in seeds]
    trainings = [
        Training(
            folder.resolve() / variant.name / f"seed-{seed}",
            variant.config.model_copy(update={"seed": seed}),
            data,
        )
        for variant, seed in pairs
    ]
    rows: dict[int, Row] = {}
    with exclusive_folder(folder), backend.active():
        for each in trainings:
            load_result(each)  # refuses other settings before any training
        for index, result in run_tasks(run_training, [(each,) for each in trainings]):
            rows[index] = Row(*pairs[index], result)
            on_result(len(rows), rows[index])
    return [rows[index] for index in range(len(pairs))]


def comparison_figures(title: str, data: CampaignData, rows: Sequence[Row]) -> dict[str, Any]:
    """The figures for `--json`.

    Those of a variant are pooled over its seeds. A ratio is that of the mean squared errors (n,) of
    the fair linear model to those of the variant.
    """
    groups = groupby(rows, key=lambda row: row.variant.name)
    return {
        "title": title,
        "baseline_mse_si": dict(zip(data.states, data.linear_mse, strict=True)),
        "variants": [_variant_figures(list(group), data.states) for _, group in groups],
    }


def _variant_figures(rows: Sequence[Row], states: Sequence[str]) -> dict[str, Any]:
    variant = rows[0].variant
    trainings = [_training_figures(row, states) for row in rows]
    models = [each for each in trainings if each["mse_ratio"]]
    means = [each["geometric_mean_ratio"] for each in models]
    ratios = {
        name: _geometric_mean([each["mse_ratio"][name] for each in models]) for name in states
    }
    return {
        "name": variant.name,
        "why": variant.why,
        "changes": dict(variant.changes),
        "n_steps": variant.config.steps,
        "n_trajectories_per_step": variant.config.batch,
        "n_parameters": next((row.result.n_parameters for row in rows if row.result.ratios), None),
        "geometric_mean_ratio": _geometric_mean(means),
        "least_geometric_mean_ratio": min(means, default=None),
        "most_geometric_mean_ratio": max(means, default=None),
        "mse_ratio": ratios if models else None,
        "training_cpu_s": fmean(each["training_cpu_s"] for each in models) if models else None,
        "trainings": trainings,
    }


def _training_figures(row: Row, states: Sequence[str]) -> dict[str, Any]:
    result, ratios = row.result, row.result.ratios
    return {
        "seed": row.seed,
        "ending": result.ending,
        "reason": result.reason,
        "step": result.step,
        "training_cpu_s": result.training_cpu_s,
        "spectral_radius": result.spectral_radius,
        "mse_ratio": ratios and dict(zip(states, ratios.by_state, strict=True)),
        "geometric_mean_ratio": ratios and ratios.geometric_mean,
    }


def _geometric_mean(ratios: Sequence[float]) -> float | None:
    if not ratios:
        return None
    return geometric_mean(ratios) if min(ratios) > 0 else 0.0


def comparison_markdown(figures: Mapping[str, Any]) -> str:
    """Three tables: pooled ratios of the variants, their changes, and all trainings."""
    variants, states = figures["variants"], tuple(figures["baseline_mse_si"])
    n_seeds = len({each["seed"] for variant in variants for each in variant["trainings"]})
    costs = {(each["n_steps"], each["n_trajectories_per_step"]) for each in variants}
    cost = "The variants differ in steps or in trajectories per step: see their changes."
    if len(costs) == 1:
        cost = "Every training has {} steps of {} trajectories.".format(*costs.pop())
    pooled = ("variant", "geometric mean", "least … most", *states, "parameters", "CPU s")
    single = ("variant", "seed", *states, "geometric mean", "radius", "step", "CPU s")
    changes = []
    for each in variants:
        texts = (f"`{field} = {json.dumps(value)}`" for field, value in each["changes"].items())
        changes.append((each["name"], ", ".join(texts) or NO_VALUE, each["why"]))
    trainings = [_cells(v["name"], each, states) for v in variants for each in v["trainings"]]
    return "\n\n".join(
        (
            f"# {figures['title']}",
            "Mean squared error over the horizon of the fair linear model, divided by that of the "
            "variant, on the validation part: more is better. The geometric mean is over the "
            f"states, and all of this table over {n_seeds} seed{'s' * (n_seeds > 1)}. {cost}",
            _markdown(pooled, [_pooled_cells(each, states) for each in variants]),
            _markdown(("variant", "changes", "why"), changes),
            _markdown(single, trainings) + "\n",
        )
    )


def _pooled_cells(variant: Mapping[str, Any], states: Sequence[str]) -> tuple[str, ...]:
    if variant["mse_ratio"] is None:
        return (variant["name"], *(NO_VALUE,) * (len(states) + 4))
    least, most = (f"{variant[f'{end}_geometric_mean_ratio']:.3g}" for end in ("least", "most"))
    ratios = (f"{variant['mse_ratio'][name]:.3g}" for name in states)
    mean, cost = f"{variant['geometric_mean_ratio']:.3g}", f"{variant['training_cpu_s']:.0f}"
    return (variant["name"], mean, f"{least} … {most}", *ratios, str(variant["n_parameters"]), cost)


def _cells(name: str, training: Mapping[str, Any], states: Sequence[str]) -> tuple[str, ...]:
    begin = (name, str(training["seed"]))
    cost = (str(training["step"]), f"{training['training_cpu_s']:.0f}")
    if training["mse_ratio"] is None:
        return (*begin, *(NO_VALUE,) * len(states), training["ending"], "", *cost)
    ratios = (f"{training['mse_ratio'][name]:.3g}" for name in states)
    mean, radius = training["geometric_mean_ratio"], training["spectral_radius"]
    return (*begin, *ratios, f"{mean:.3g}", f"{radius:.5f}", *cost)


def _markdown(heads: Sequence[str], rows: Sequence[tuple[str, ...]]) -> str:
    return to_markdown(Table("", tuple(map(Column, heads)), tuple(rows)))
