"""Figures of several rounds in one table: medians, and ratios within a round."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import pandas as pd
from rich.table import Table

T = TypeVar("T")


class Ratio(NamedTuple):
    """Ratio to another figure of the same round: median, smallest and largest of all rounds."""

    median: float
    least: float
    most: float

    def __str__(self) -> str:
        return f"{self.median:.2f} ({self.least:.2f}–{self.most:.2f})"


def timed(action: Callable[..., T], *arguments: Any) -> tuple[T, float]:
    """What the action returns, and the time it took in us."""
    begun_ns = time.perf_counter_ns()
    result = action(*arguments)
    return result, (time.perf_counter_ns() - begun_ns) / 1e3


def percentiles(times_us: Any, prefix: str = "") -> dict[str, float]:
    """Median, 99th percentile (a time that was measured) and maximum."""
    times = pd.Series(times_us)
    return {
        f"{prefix}p50_us": float(times.median()),
        f"{prefix}p99_us": float(times.quantile(0.99, interpolation="higher")),
        f"{prefix}max_us": float(times.max()),
    }


def summarise(
    rounds: pd.DataFrame, ratios_of: Sequence[str], references: Mapping[str, str]
) -> pd.DataFrame:
    """A row for each `name`: medians over the rounds, and `Ratio` columns.

    `rounds` has the columns `round`, `name` and figures. The ratio of a figure to the one of
    `references[label]` in the same round is in the column FIGURE_over_LABEL.
    """
    figures = rounds.set_index(["round", "name"])
    summary = figures.groupby("name", sort=False).median()
    for label, reference in references.items():
        others = figures.xs(reference, level="name")
        for figure in ratios_of:
            ratios = figures[figure].div(others[figure], level="round").groupby("name")
            summary[f"{figure}_over_{label}"] = pd.Series(
                {
                    name: Ratio(float(found.median()), float(found.min()), float(found.max()))
                    for name, found in ratios
                }
            )
    return summary


def to_table(title: str, figures: pd.DataFrame, heads: Mapping[str, str]) -> Table:
    """The columns of `heads` with these headings; the index first, numbers with 3 digits."""
    rows = zip(figures.index, *(figures[column] for column in heads), strict=True)
    return table(
        title, (figures.index.name, *heads.values()), [[_text(x) for x in row] for row in rows]
    )


def table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """A table whose first column is left-aligned and all others right-aligned."""
    made = Table(title=title, title_justify="left")
    for index, head in enumerate(heads):
        made.add_column(head, justify="right" if index else "left", no_wrap=True)
    for row in rows:
        made.add_row(*row)
    return made


def to_plain(figures: pd.DataFrame) -> dict[str, dict[str, Any]]:
    return {
        str(name): {column: x._asdict() if isinstance(x, Ratio) else x for column, x in row.items()}
        for name, row in figures.to_dict("index").items()
    }


def _text(x: Any) -> str:
    if not isinstance(x, float):
        return str(x)
    return f"{x:.0f}" if abs(x) >= 100.0 else f"{x:.3g}"
