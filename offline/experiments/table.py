"""Results of a comparison: Markdown for people, figures for `--json`."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, geometric_mean
from typing import Any

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


def comparison_figures(title: str, data: CampaignData, rows: Sequence[Row]) -> dict[str, Any]:
    """The figures for `--json`.

    Those of a variant are pooled over its seeds. A ratio is that of the mean squared errors (n,) of
    the fair linear model to those of the variant.
    """
    by_name: dict[str, list[Row]] = {}
    for row in rows:
        by_name.setdefault(row.variant.name, []).append(row)
    return {
        "title": title,
        "baseline_mse_si": dict(zip(data.states, data.linear_mse, strict=True)),
        "variants": [_variant_figures(each, data.states) for each in by_name.values()],
    }


def comparison_markdown(title: str, data: CampaignData, rows: Sequence[Row]) -> str:
    """Three tables: pooled ratios of the variants, their changes, and all trainings."""
    variants, states = comparison_figures(title, data, rows)["variants"], data.states
    n_seeds = len({row.seed for row in rows})
    pooled = ("variant", "geometric mean", "least … most", *states, "parameters", "CPU s")
    single = ("variant", "seed", *states, "geometric mean", "radius", "step", "CPU s")
    changes = [(each["name"], _changes(each["changes"]), each["why"]) for each in variants]
    trainings = [(variant["name"], each) for variant in variants for each in variant["trainings"]]
    return "\n\n".join(
        (
            f"# {title}",
            "Mean squared error over the horizon of the fair linear model, divided by that of the "
            "variant, on the validation part: more is better. The geometric mean is over the "
            f"states, and all of this table over {n_seeds} seed{'s' * (n_seeds > 1)}. "
            f"{_cost(rows)}",
            _markdown(pooled, [_pooled_cells(variant, states) for variant in variants]),
            _markdown(("variant", "changes", "why"), changes),
            _markdown(single, [(name, *_cells(each, states)) for name, each in trainings]) + "\n",
        )
    )


def _variant_figures(rows: Sequence[Row], states: Sequence[str]) -> dict[str, Any]:
    variant = rows[0].variant
    models = [(row.result, row.result.ratios) for row in rows if row.result and row.result.ratios]
    means = [ratios.geometric_mean for _, ratios in models]
    by_state = zip(*(ratios.by_state for _, ratios in models), strict=True)
    pooled = dict(zip(states, map(_geometric_mean, by_state), strict=bool(models)))
    return {
        "name": variant.name,
        "why": variant.why,
        "changes": dict(variant.changes),
        "n_steps": variant.config.steps,
        "n_trajectories_per_step": variant.config.batch,
        "n_parameters": models[0][0].n_parameters if models else None,
        "geometric_mean_ratio": _geometric_mean(means) if models else None,
        "least_geometric_mean_ratio": min(means, default=None),
        "most_geometric_mean_ratio": max(means, default=None),
        "mse_ratio": pooled or None,
        "training_cpu_s": fmean(each.training_cpu_s for each, _ in models) if models else None,
        "trainings": [_training_figures(row, states) for row in rows],
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


def _pooled_cells(variant: dict[str, Any], states: Sequence[str]) -> tuple[str, ...]:
    if variant["mse_ratio"] is None:
        return (variant["name"], *(NO_VALUE for _ in range(len(states) + 4)))
    least, most = variant["least_geometric_mean_ratio"], variant["most_geometric_mean_ratio"]
    return (
        variant["name"],
        f"{variant['geometric_mean_ratio']:.3g}",
        f"{least:.3g} … {most:.3g}",
        *(f"{variant['mse_ratio'][state]:.3g}" for state in states),
        str(variant["n_parameters"]),
        f"{variant['training_cpu_s']:.0f}",
    )


def _cells(training: dict[str, Any], states: Sequence[str]) -> tuple[str, ...]:
    seed, ending = str(training["seed"]), training["ending"]
    if ending is None:
        return (seed, *(NO_VALUE for _ in states), "not ended", "", "", "")
    cost = (str(training["step"]), f"{training['training_cpu_s']:.0f}")
    if training["mse_ratio"] is None:
        return (seed, *(NO_VALUE for _ in states), ending, "", *cost)
    ratios = (f"{training['mse_ratio'][state]:.3g}" for state in states)
    mean = f"{training['geometric_mean_ratio']:.3g}"
    return (seed, *ratios, mean, f"{training['spectral_radius']:.5f}", *cost)


def _cost(rows: Sequence[Row]) -> str:
    """Whether all variants have the same cost; otherwise the comparison is not fair."""
    costs = {(row.variant.config.steps, row.variant.config.batch) for row in rows}
    if len(costs) > 1:
        return "The variants differ in steps or in trajectories per step: see their changes."
    ((steps, batch),) = costs
    return f"Every training has {steps} steps of {batch} trajectories."


def _geometric_mean(ratios: Sequence[float]) -> float:
    return geometric_mean(ratios) if min(ratios) > 0 else 0.0


def _changes(changes: dict[str, Any]) -> str:
    texts = (f"`{field} = {json.dumps(value)}`" for field, value in changes.items())
    return ", ".join(texts) or NO_VALUE


def _markdown(heads: Sequence[str], rows: Sequence[tuple[str, ...]]) -> str:
    return to_markdown(Table("", tuple(map(Column, heads)), tuple(rows)))
