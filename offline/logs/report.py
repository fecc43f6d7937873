"""The report on an import: figures for `--json`, and tables for the terminal."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, astuple, dataclass
from typing import Any

from offline.config import STEPS
from offline.data.dataset import PARTS
from offline.logs.checks.coverage import Occupancy, Range
from offline.logs.checks.pairs import Proportion, TimeShift
from offline.logs.checks.samples import Gaps, Issue, Outliers
from rt_controller.report.table import Column, Row, Table, format_number


@dataclass(frozen=True, slots=True)
class FileReport:
    """What was made of one log."""

    name: str
    rows: int
    duration_s: float
    slowest_step_s: float
    """usual time between two samples of the slowest signal"""
    stretches: int
    episodes: int
    kept_s: float
    too_short: int
    """stretches left out because a window of steps and its past does not fit"""
    off_line: int
    """periods in which the pose could not be projected onto the reference line"""
    gaps: Gaps


@dataclass(frozen=True, slots=True)
class EpisodeReport:
    """Origin and part of an episode."""

    file: str
    begin_s: float
    duration_s: float
    part: str


@dataclass(frozen=True, slots=True)
class ImportReport:
    """Everything that is reported about an import."""

    period_s: float
    files: tuple[FileReport, ...]
    episodes: tuple[EpisodeReport, ...]
    slices: tuple[int, ...]
    """windows for train, validation and test"""
    ranges: tuple[Range, ...]
    occupancy: Occupancy | None
    outliers: tuple[Outliers, ...]
    time_shifts: tuple[TimeShift, ...]
    proportions: tuple[Proportion, ...]
    constant: tuple[str, ...]
    unchecked: tuple[str, ...]
    """units and periods that no other signal confirms"""
    issues: tuple[Issue, ...]

    def figures(self) -> dict[str, Any]:
        """All fields and their totals, for JSON."""
        fields = asdict(self)
        return {
            "n_rows": sum(file.rows for file in self.files),
            "duration_s": sum(file.duration_s for file in self.files),
            "kept_s": sum(file.kept_s for file in self.files),
            "n_episodes": len(self.episodes),
            "n_too_short": sum(file.too_short for file in self.files),
            "n_slices": dict(zip(PARTS, fields.pop("slices"), strict=True)),
            **fields,
        }

    def tables(self) -> list[Table]:
        """All fields except the single episodes, outliers and proportions."""
        tables = [_file_table(self.files), _range_table(self.ranges)]
        if self.occupancy:
            tables.append(_occupancy_table(self.occupancy))
        if self.time_shifts:
            tables.append(_shift_table(self.time_shifts))
        if self.issues:
            title, heads = "Check these before training", ("check", "subject", "issue")
            tables.append(_table(title, heads, 3, map(astuple, self.issues)))
        return tables

    def limits(self) -> str:
        """One sentence on what was not checked; empty if there is nothing."""
        if not self.unchecked:
            return ""
        return (
            f"Not checked, because nothing in the logs confirms it: {', '.join(self.unchecked)}. "
            f"Compare the ranges with what the car did."
        )

    def summary(self) -> str:
        """One sentence on episodes and windows."""
        train, validation, test = self.slices
        total = self.figures()
        return (
            f"{len(self.episodes)} episodes, {total['kept_s']:.0f} s at {1e3 * self.period_s:g} "
            f"ms, {total['n_too_short']} stretches too short and left out; windows of "
            f"{STEPS} steps: {train} train, {validation} validation, {test} test"
        )


def _table(title: str, heads: Sequence[str], texts: int, rows: Iterable[Row]) -> Table:
    """A table whose first columns are texts; a head is "title" or "title, unit"."""
    parts = (head.partition(", ") for head in heads)
    columns = tuple(Column(name, unit, i < texts) for i, (name, _, unit) in enumerate(parts))
    return Table(title, columns, tuple(rows))


def _file_table(files: Sequence[FileReport]) -> Table:
    heads = ("log", "rows", "duration, s", "row every, ms", "stretches", "episodes", "kept, s")
    rows: list[Row] = []
    for file in files:
        times = (f"{file.duration_s:.1f}", format_number(1e3 * file.slowest_step_s))
        counts = (str(file.stretches), str(file.episodes))
        rows.append((file.name, str(file.rows), *times, *counts, f"{file.kept_s:.1f}"))
    return _table("Logs", heads, 1, rows)


def _range_table(ranges: Sequence[Range]) -> Table:
    heads = ("signal", "unit", "lowest", "5 %", "median", "95 %", "highest")
    rows = (
        (name, unit, *(format_number(number, 3) for number in numbers))
        for name, unit, *numbers in map(astuple, ranges)
    )
    return _table("Coverage", heads, 2, rows)


def _occupancy_table(occupancy: Occupancy) -> Table:
    title = (
        f"Share of the samples in %: {occupancy.down} (rows) and {occupancy.across} (columns), "
        f"cells from the given number on; {100 * occupancy.filled:.0f} % of the cells filled"
    )
    heads = ("from", *(format_number(low, 3) for low in occupancy.across_edges[:-1]))
    rows = [
        (format_number(low, 3), *(f"{100 * share:.1f}" if share else "" for share in shares))
        for low, shares in zip(occupancy.down_edges[:-1], occupancy.share, strict=True)
    ]
    return _table(title, heads, 0, rows[::-1])


def _shift_table(shifts: Sequence[TimeShift]) -> Table:
    heads = ("cause", "response", "lag, s", "correlation", "expected, s")
    rows: list[Row] = []
    for shift in shifts:
        expected = f"{shift.expected.earliest_s:.2f}..{shift.expected.latest_s:.2f}"
        found = (f"{shift.lag_s:+.3f}", f"{shift.correlation:.3f}")
        rows.append((shift.cause, shift.response, *found, expected))
    return _table("Time shifts", heads, 2, rows)
