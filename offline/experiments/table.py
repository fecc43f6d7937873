"""Results of a comparison: Markdown for people, figures for `--json`."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, geometric_mean
from typing import Any

from offline.experiments.error_ratios import ErrorRatios
from offline.experiments.training_task import CampaignData, Result
from offline.experiments.variants import Variant
from rt_controller.report.table import NO_VALUE, Column, Table, to_markdown


@dataclass(frozen=True, slots=True)
class Row:
    """One training of a variant."""

    variant: Variant
    seed: int
    result: Result | None
    """None: it has not ended"""


@dataclass(frozen=True, slots=True)
class VariantResult:
    """All trainings of one variant; those that have a model are pooled over their seeds."""

    variant: Variant
    rows: tuple[Row, ...]
    ratios: ErrorRatios | None
    """geometric means over the seeds; None: no training has a model"""
    mean_ratios: tuple[float, ...]
    """geometric mean over the states, of each seed with a model"""
    n_parameters: int | None
    training_cpu_s: float | None
    """mean"""


def pool_seeds(rows: Sequence[Row]) -> tuple[VariantResult, ...]:
    """The results of each variant, in the order of the rows."""
    by_name: dict[str, list[Row]] = {}
    for row in rows:
        by_name.setdefault(row.variant.name, []).append(row)
    return tuple(map(_pooled, by_name.values()))


def comparison_figures(
    title: str, data: CampaignData, results: Sequence[VariantResult]
) -> dict[str, Any]:
    """The figures for `--json`.

    Those of a variant are pooled over its seeds. A ratio is that of the mean squared errors (n,) of
    the fair linear model to those of the variant.
    """
    return {
        "title": title,
        "baseline_mse_si": dict(zip(data.states, data.linear_mse, strict=True)),
        "variants": [_variant_figures(each, data.states) for each in results],
    }


def comparison_markdown(title: str, data: CampaignData, results: Sequence[VariantResult]) -> str:
    """Three tables: pooled ratios of the variants, their changes, and all trainings."""
    rows = [row for each in results for row in each.rows]
    n_seeds = len({row.seed for row in rows})
    states = data.states
    pooled = ("variant", "geometric mean", "least … most", *states, "parameters", "CPU s")
    single = ("variant", "seed", *states, "geometric mean", "radius", "step", "CPU s")
    variants = [each.variant for each in results]
    changes = [(each.name, _changes(each.changes), each.why) for each in variants]
    return "\n\n".join(
        (
            f"# {title}",
            "Mean squared error over the horizon of the fair linear model, divided by that of the "
            "variant, on the validation part: more is better. The geometric mean is over the "
            f"states, and all of this table over {n_seeds} seed{'s' * (n_seeds > 1)}. "
            f"{_cost(variants)}",
            _markdown(pooled, [_pooled_cells(each, len(states)) for each in results]),
            _markdown(("variant", "changes", "why"), changes),
            _markdown(single, [_cells(row, len(states)) for row in rows]) + "\n",
        )
    )


def _pooled(rows: Sequence[Row]) -> VariantResult:
    models = [(row.result, row.result.ratios) for row in rows if row.result and row.result.ratios]
    means = tuple(ratios.geometric_mean for _, ratios in models)
    by_state = zip(*(ratios.by_state for _, ratios in models), strict=True)
    pooled = tuple(map(_geometric_mean, by_state))
    return VariantResult(
        rows[0].variant,
        tuple(rows),
        ErrorRatios(pooled, _geometric_mean(means)) if models else None,
        means,
        models[0][0].n_parameters if models else None,
        fmean(each.training_cpu_s for each, _ in models) if models else None,
    )


def _variant_figures(result: VariantResult, states: Sequence[str]) -> dict[str, Any]:
    variant, ratios = result.variant, result.ratios
    return {
        "name": variant.name,
        "why": variant.why,
        "changes": dict(variant.changes),
        "n_steps": variant.config.steps,
        "n_trajectories_per_step": variant.config.batch,
        "n_parameters": result.n_parameters,
        "geometric_mean_ratio": ratios and ratios.geometric_mean,
        "least_geometric_mean_ratio": min(result.mean_ratios, default=None),
        "most_geometric_mean_ratio": max(result.mean_ratios, default=None),
        "mse_ratio": ratios and dict(zip(states, ratios.by_state, strict=True)),
        "training_cpu_s": result.training_cpu_s,
        "trainings": [_training_figures(row, states) for row in result.rows],
    }


def _training_figures(row: Row, states: Sequence[str]) -> dict[str, Any]:
    result = row.result
    if result is None:
        return {"seed": row.seed, "ending": None}
    ratios = result.ratios
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


def _pooled_cells(result: VariantResult, n_states: int) -> tuple[str, ...]:
    name, ratios, means = result.variant.name, result.ratios, result.mean_ratios
    if ratios is None:
        return (name, *(NO_VALUE,) * (n_states + 4))
    return (
        name,
        f"{ratios.geometric_mean:.3g}",
        f"{min(means):.3g} … {max(means):.3g}",
        *(f"{ratio:.3g}" for ratio in ratios.by_state),
        str(result.n_parameters),
        f"{result.training_cpu_s:.0f}",
    )


def _cells(row: Row, n_states: int) -> tuple[str, ...]:
    name, seed, result = row.variant.name, str(row.seed), row.result
    no_ratios = (NO_VALUE,) * n_states
    if result is None:
        return (name, seed, *no_ratios, "not ended", "", "", "")
    cost = (str(result.step), f"{result.training_cpu_s:.0f}")
    if result.ratios is None:
        return (name, seed, *no_ratios, result.ending, "", *cost)
    ratios = (f"{ratio:.3g}" for ratio in result.ratios.by_state)
    mean = f"{result.ratios.geometric_mean:.3g}"
    return (name, seed, *ratios, mean, f"{result.spectral_radius:.5f}", *cost)


def _cost(variants: Sequence[Variant]) -> str:
    """Whether all variants have the same cost; otherwise the comparison is not fair."""
    costs = {(variant.config.steps, variant.config.batch) for variant in variants}
    if len(costs) > 1:
        return "The variants differ in steps or in trajectories per step: see their changes."
    ((steps, batch),) = costs
    return f"Every training has {steps} steps of {batch} trajectories."


def _geometric_mean(ratios: Sequence[float]) -> float:
    return geometric_mean(ratios) if min(ratios) > 0 else 0.0


def _changes(changes: Mapping[str, Any]) -> str:
    texts = (f"`{field} = {json.dumps(value)}`" for field, value in changes.items())
    return ", ".join(texts) or NO_VALUE


def _markdown(heads: Sequence[str], rows: Sequence[tuple[str, ...]]) -> str:
    return to_markdown(Table("", tuple(map(Column, heads)), tuple(rows)))
