"""What a campaign found, as Markdown for people and as figures for programs."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from offline.campaign.result import Result
from offline.campaign.variants import Variant


@dataclass(frozen=True, slots=True)
class Row:
    """One training of a variant."""

    variant: Variant
    seed: int
    result: Result | None
    """None: it has not ended"""


@dataclass(frozen=True, slots=True)
class Table:
    """All trainings of a list of variants, in its order."""

    title: str
    states: tuple[str, ...]
    rival: tuple[float, ...]
    """mean squared errors (n,) of the fair linear model, which the ratios are of"""
    rows: tuple[Row, ...]

    @property
    def variants(self) -> tuple[Variant, ...]:
        """In the order of the list, each once."""
        return tuple({row.variant.name: row.variant for row in self.rows}.values())

    def summarise(self, variant: Variant) -> "Summary":
        """What the variant's seeds that gave a model have in common."""
        models = [
            (row.result, row.result.score)
            for row in self.rows
            if row.variant.name == variant.name and row.result and row.result.score
        ]
        by_state = zip(*(score.ratios for _, score in models), strict=True)
        return Summary(
            geometric_means=tuple(score.geometric_mean for _, score in models),
            ratios=tuple(_geometric_mean(ratios) for ratios in by_state),
            n_parameters=models[0][0].n_parameters if models else None,
            training_cpu_s=tuple(result.training_cpu_s for result, _ in models),
        )


@dataclass(frozen=True, slots=True)
class Summary:
    """Trainings of one variant, of which each gave a model; nothing in it if none did."""

    geometric_means: tuple[float, ...]
    """of each seed: over the states"""
    ratios: tuple[float, ...]
    """of each state: the geometric mean over the seeds"""
    n_parameters: int | None
    training_cpu_s: tuple[float, ...]
    """of each seed"""


def to_markdown(table: Table) -> str:
    """Three tables: the variants with what their seeds say, what they are, and every training."""
    seeds = len({row.seed for row in table.rows})
    figures = ("geometric mean", "least … most", *table.states, "parameters", "CPU s")
    every = ("seed", *table.states, "geometric mean", "radius", "step", "CPU s")
    return "\n".join(
        (
            f"# {table.title}",
            "",
            "How many times less the mean squared error over the horizon is than that of the fair "
            "linear model, on the validation part: more is better. The geometric mean is over the "
            f"states, and all of this table over {seeds} seed{'s' * (seeds > 1)}. {_budget(table)}",
            "",
            *_markdown(
                ("variant", *figures),
                [(v.name, *_summary_cells(table, v)) for v in table.variants],
            ),
            "",
            *_markdown(
                ("variant", "changes", "why"),
                [(v.name, _settings(v.changes), v.why) for v in table.variants],
            ),
            "",
            *_markdown(
                ("variant", *every),
                [(row.variant.name, *_cells(row, len(table.states))) for row in table.rows],
            ),
            "",
        )
    )


def to_figures(table: Table) -> dict[str, Any]:
    """The same for `--json`."""
    return {
        "title": table.title,
        "rival_mse_si": dict(zip(table.states, table.rival, strict=True)),
        "variants": [_variant_figures(table, variant) for variant in table.variants],
    }


def _variant_figures(table: Table, variant: Variant) -> dict[str, Any]:
    summary = table.summarise(variant)
    means = summary.geometric_means
    return {
        "name": variant.name,
        "why": variant.why,
        "changes": dict(variant.changes),
        "n_steps": variant.config.steps,
        "n_trajectories_per_step": variant.config.batch,
        "n_parameters": summary.n_parameters,
        "geometric_mean_ratio": _geometric_mean(means) if means else None,
        "least_geometric_mean_ratio": min(means, default=None),
        "most_geometric_mean_ratio": max(means, default=None),
        "mse_ratio": dict(zip(table.states, summary.ratios, strict=True)) if means else None,
        "training_cpu_s": _mean(summary.training_cpu_s) if means else None,
        "trainings": [
            _training_figures(row, table.states)
            for row in table.rows
            if row.variant.name == variant.name
        ],
    }


def _training_figures(row: Row, states: Sequence[str]) -> dict[str, Any]:
    result = row.result
    if result is None:
        return {"seed": row.seed, "ending": None}
    score = result.score
    return {
        "seed": row.seed,
        "ending": result.ending,
        "reason": result.reason,
        "step": result.step,
        "training_cpu_s": result.training_cpu_s,
        "spectral_radius": result.spectral_radius,
        "mse_ratio": score and dict(zip(states, score.ratios, strict=True)),
        "geometric_mean_ratio": score and score.geometric_mean,
    }


def _summary_cells(table: Table, variant: Variant) -> tuple[str, ...]:
    summary = table.summarise(variant)
    means = summary.geometric_means
    if not means:
        return tuple("–" for _ in range(len(table.states) + 4))
    return (
        f"{_geometric_mean(means):.3g}",
        f"{min(means):.3g} … {max(means):.3g}",
        *(f"{ratio:.3g}" for ratio in summary.ratios),
        str(summary.n_parameters),
        f"{_mean(summary.training_cpu_s):.0f}",
    )


def _cells(row: Row, states: int) -> tuple[str, ...]:
    result = row.result
    if result is None or result.score is None:
        ending = "not ended" if result is None else result.ending
        rest = ("", "") if result is None else (str(result.step), f"{result.training_cpu_s:.0f}")
        return (str(row.seed), *("–" for _ in range(states)), ending, "", *rest)
    return (
        str(row.seed),
        *(f"{ratio:.3g}" for ratio in result.score.ratios),
        f"{result.score.geometric_mean:.3g}",
        f"{result.spectral_radius:.5f}",
        str(result.step),
        f"{result.training_cpu_s:.0f}",
    )


def _budget(table: Table) -> str:
    """Whether the variants were given the same: otherwise the table compares two things."""
    budgets = {(variant.config.steps, variant.config.batch) for variant in table.variants}
    if len(budgets) > 1:
        return "The variants differ in steps or in trajectories a step: see their changes."
    ((steps, batch),) = budgets
    return f"Every training has {steps} steps of {batch} trajectories."


def _geometric_mean(ratios: Sequence[float]) -> float:
    return math.exp(_mean([math.log(ratio) for ratio in ratios])) if min(ratios) > 0 else 0.0


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


def _settings(changes: Mapping[str, Any]) -> str:
    said = (f"`{field} = {json.dumps(value)}`" for field, value in changes.items())
    return ", ".join(said) or "–"


def _markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [
        f"| {' | '.join(heads)} |",
        f"|{'|'.join('---' for _ in heads)}|",
        *(f"| {' | '.join(row)} |" for row in rows),
    ]
