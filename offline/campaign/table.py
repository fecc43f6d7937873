"""What a campaign found, as a Markdown table for people and as figures for programs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from offline.campaign.trainings import Result
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

    def geometric_means(self, variant: Variant) -> tuple[float, ...]:
        """Of the seeds that gave a model, in the order of the seeds."""
        return tuple(
            row.result.score.geometric_mean
            for row in self.rows
            if row.variant.name == variant.name and row.result and row.result.score
        )


def to_markdown(table: Table) -> str:
    """Two tables: the variants with what their seeds have in common, and every training."""
    seeds = sorted({row.seed for row in table.rows})
    heads = ("variant", "changes", "geometric mean", "least … most", "why")
    summary = [
        (v.name, _settings(v.changes), *_spread(table.geometric_means(v)), v.why)
        for v in table.variants
    ]
    heads_all = ("variant", "seed", *table.states, "geometric mean", "radius", "step", "time s")
    every = [
        (row.variant.name, str(row.seed), *_cells(row, len(table.states))) for row in table.rows
    ]
    return "\n".join(
        (
            f"# {table.title}",
            "",
            "How many times less the mean squared error over 80 steps is than that of the fair "
            "linear model, on the validation part: more is better. The geometric mean is over "
            f"the states, and here over {len(seeds)} seed{'s' * (len(seeds) > 1)}.",
            "",
            *_markdown(heads, summary),
            "",
            *_markdown(heads_all, every),
            "",
        )
    )


def to_figures(table: Table) -> dict[str, Any]:
    """The same for `--json`."""
    return {
        "title": table.title,
        "rival_mse_si": dict(zip(table.states, table.rival, strict=True)),
        "variants": [
            {
                "name": variant.name,
                "why": variant.why,
                "changes": dict(variant.changes),
                "geometric_mean_ratio": _mean(table.geometric_means(variant)),
                "trainings": [
                    _figures(row, table.states)
                    for row in table.rows
                    if row.variant.name == variant.name
                ],
            }
            for variant in table.variants
        ],
    }


def _figures(row: Row, states: Sequence[str]) -> dict[str, Any]:
    result = row.result
    if result is None:
        return {"seed": row.seed, "ending": None}
    score = result.score
    return {
        "seed": row.seed,
        "ending": result.ending,
        "reason": result.reason,
        "step": result.step,
        "training_s": result.training_s,
        "spectral_radius": result.spectral_radius,
        "mse_ratio": score and dict(zip(states, score.ratios, strict=True)),
        "geometric_mean_ratio": score and score.geometric_mean,
    }


def _cells(row: Row, states: int) -> tuple[str, ...]:
    result = row.result
    if result is None or result.score is None:
        ending = "not ended" if result is None else result.ending
        rest = ("", "") if result is None else (str(result.step), f"{result.training_s:.0f}")
        return (*("–" for _ in range(states)), ending, "", *rest)
    return (
        *(f"{ratio:.3g}" for ratio in result.score.ratios),
        f"{result.score.geometric_mean:.3g}",
        f"{result.spectral_radius:.5f}",
        str(result.step),
        f"{result.training_s:.0f}",
    )


def _spread(means: Sequence[float]) -> tuple[str, str]:
    mean = _mean(means)
    return ("–", "–") if mean is None else (f"{mean:.3g}", f"{min(means):.3g} … {max(means):.3g}")


def _mean(means: Sequence[float]) -> float | None:
    """Geometric, as ratios ask for; None of nothing."""
    if not means:
        return None
    return math.exp(math.fsum(map(math.log, means)) / len(means)) if min(means) > 0 else 0.0


def _settings(changes: Mapping[str, Any]) -> str:
    return ", ".join(f"`{field} = {value}`" for field, value in changes.items()) or "–"


def _markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [
        f"| {' | '.join(heads)} |",
        f"|{'|'.join('---' for _ in heads)}|",
        *(f"| {' | '.join(row)} |" for row in rows),
    ]
