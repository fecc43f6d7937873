"""Figures of several rounds in one table: medians, and ratios within a round."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import pandas as pd

from rt_controller.report.table import Cell, Column, Table, format_number

T = TypeVar("T")


class Ratio(NamedTuple):
    """Ratio to another figure of the same round: median, smallest and largest of all rounds."""

    median: float
    least: float
    most: float


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


def to_tables(
    title: str, figures: pd.DataFrame, heads: Mapping[str, Mapping[str, Column]]
) -> Iterator[Table]:
    """A table for each of `heads`: the index, then its columns of `figures` with their heads.

    Several narrow tables fit into a terminal; one with all columns does not.
    """
    index = Column(str(figures.index.name), is_text=True)
    for subject, columns in heads.items():
        rows = zip(figures.index, *(map(_cell, figures[name]) for name in columns), strict=True)
        yield Table(f"{title}: {subject}", (index, *columns.values()), tuple(rows))


def to_plain(figures: pd.DataFrame) -> dict[str, dict[str, Any]]:
    return {
        str(name): {column: x._asdict() if isinstance(x, Ratio) else x for column, x in row.items()}
        for name, row in figures.to_dict("index").items()
    }


def _cell(x: Any) -> Cell:
    if isinstance(x, Ratio):
        return Cell(_ratio(x.median), f"{_ratio(x.least)}–{_ratio(x.most)}")
    return Cell(format_number(x, 3) if isinstance(x, float) else str(x))


def _ratio(x: float) -> str:
    return f"{x:.2f}" if x < 10.0 else format_number(x, 3)
