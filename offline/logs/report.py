"""What an import found, as figures for a program and as tables for a person."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from offline.logs.coverage import Occupancy, Range
from offline.logs.finding import Finding
from offline.logs.gap import Gaps
from offline.logs.outliers import Outliers
from offline.logs.time_shift import TimeShift
from offline.logs.unit_check import Proportion


@dataclass(frozen=True, slots=True)
class FileReport:
    """What became of one log."""

    name: str
    rows: int
    duration_s: float
    slowest_step_s: float
    """usual time between two samples of the slowest signal"""
    stretches: int
    """without gap"""
    episodes: int
    kept_s: float
    too_short: int
    """stretches left out, since no window of steps and its past fits"""
    off_line: int
    """periods in which the pose could not be told against the reference line"""
    gaps: Gaps


@dataclass(frozen=True, slots=True)
class EpisodeReport:
    """Where an episode comes from and what it is for."""

    file: str
    begin_s: float
    duration_s: float
    part: str


@dataclass(frozen=True, slots=True)
class ImportReport:
    """Everything that is told about an import."""

    period_s: float
    files: tuple[FileReport, ...]
    episodes: tuple[EpisodeReport, ...]
    slices: tuple[int, int, int]
    """windows for train, validation and test"""
    ranges: tuple[Range, ...]
    occupancy: Occupancy | None
    outliers: tuple[Outliers, ...]
    time_shifts: tuple[TimeShift, ...]
    proportions: tuple[Proportion, ...]
    constant: tuple[str, ...]
    """signals that never move, which the mapping allows"""
    findings: tuple[Finding, ...]

    def figures(self) -> dict[str, Any]:
        """All of it, for JSON."""
        occupancy = self.occupancy
        return {
            "period_s": self.period_s,
            "n_rows": sum(file.rows for file in self.files),
            "duration_s": sum(file.duration_s for file in self.files),
            "kept_s": sum(file.kept_s for file in self.files),
            "n_episodes": len(self.episodes),
            "n_too_short": sum(file.too_short for file in self.files),
            "n_slices": dict(zip(("train", "validation", "test"), self.slices, strict=True)),
            "files": [{**asdict(file), "gaps": file.gaps._asdict()} for file in self.files],
            "episodes": [asdict(episode) for episode in self.episodes],
            "ranges": [each._asdict() for each in self.ranges],
            "occupancy": occupancy
            and {
                "across": occupancy.across,
                "down": occupancy.down,
                "across_edges": occupancy.across_edges.tolist(),
                "down_edges": occupancy.down_edges.tolist(),
                "share": occupancy.share.tolist(),
                "filled": occupancy.filled,
            },
            "outliers": [each._asdict() for each in self.outliers],
            "time_shifts": [
                {**each._asdict(), "own": each.own._asdict()} for each in self.time_shifts
            ],
            "proportions": [each._asdict() for each in self.proportions],
            "constant": list(self.constant),
            "findings": [each._asdict() for each in self.findings],
        }

    def tables(self) -> RenderableType:
        """All but the single episodes, for a terminal."""
        parts: list[RenderableType] = [
            _file_table(self.files),
            _range_table(self.ranges),
        ]
        if self.occupancy:
            parts.append(_occupancy_table(self.occupancy))
        if self.time_shifts:
            parts.append(_shift_table(self.time_shifts))
        if self.findings:
            parts.append(_finding_table(self.findings))
        parts.append(self._summary())
        return Group(*parts)

    def _summary(self) -> Text:
        train, validation, test = self.slices
        kept_s = sum(file.kept_s for file in self.files)
        too_short = sum(file.too_short for file in self.files)
        return Text(
            f"{len(self.episodes)} episodes, {kept_s:.0f} s at {1e3 * self.period_s:g} ms, "
            f"{too_short} stretches too short and left out; windows of 80 steps: {train} train, "
            f"{validation} validation, {test} test"
        )


def _table(title: str, *heads: str) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column(heads[0], overflow="fold", min_width=10)
    for head in heads[1:]:
        table.add_column(head, justify="right", overflow="fold")
    return table


def _file_table(files: Sequence[FileReport]) -> Table:
    heads = ("log", "rows", "s", "ms a row", "stretches", "episodes", "kept s")
    table = _table("Logs", *heads)
    for file in files:
        table.add_row(
            Text(file.name),
            str(file.rows),
            f"{file.duration_s:.1f}",
            f"{1e3 * file.slowest_step_s:.4g}",
            str(file.stretches),
            str(file.episodes),
            f"{file.kept_s:.1f}",
        )
    return table


def _range_table(ranges: Sequence[Range]) -> Table:
    heads = ("signal", "unit", "lowest", "5 %", "median", "95 %", "highest")
    table = _table("Coverage", *heads)
    for each in ranges:
        numbers = (each.lowest, each.q05, each.median, each.q95, each.highest)
        table.add_row(each.name, each.unit, *(f"{number:.3g}" for number in numbers))
    return table


def _occupancy_table(occupancy: Occupancy) -> Table:
    table = _table(
        f"Share of the samples in %, {occupancy.down} (lines) against {occupancy.across} "
        f"(columns), cells from the given number on; {100 * occupancy.filled:.0f} % of them filled",
        "from",
        *(f"{low:.3g}" for low in occupancy.across_edges[:-1]),
    )
    lines = zip(occupancy.down_edges[:-1], occupancy.share, strict=True)
    for low, shares in list(lines)[::-1]:
        cells = (f"{100 * share:.1f}" if share else "" for share in shares)
        table.add_row(f"{low:.3g}", *cells)
    return table


def _shift_table(shifts: Sequence[TimeShift]) -> Table:
    table = _table("Time shifts", "cause", "response", "s later", "correlation", "expected s")
    for shift in shifts:
        table.add_row(
            shift.cause,
            shift.response,
            f"{shift.lag_s:+.3f}",
            f"{shift.correlation:.3f}",
            f"{shift.own.earliest_s:.2f}..{shift.own.latest_s:.2f}",
        )
    return table


def _finding_table(findings: Sequence[Finding]) -> Table:
    table = Table(title="Look at these before training", title_justify="left")
    for head in ("about", "of", "what"):
        table.add_column(head, overflow="fold")
    for each in findings:
        # As text: a bracket in it is no markup.
        table.add_row(*map(Text, each))
    return table
