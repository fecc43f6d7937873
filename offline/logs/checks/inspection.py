"""All checks of logs before they become a data set: what is refused, and what is reported.

The report is figures for `--json`, and tables for the terminal.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from offline.config import STEPS
from offline.data.manifest import PARTS
from offline.data.recording import Starts
from offline.logs.checks.pairs import (
    Proportion,
    TimeShift,
    find_proportions,
    find_time_shifts,
    find_unchecked,
    time_shift_issues,
    unit_issues,
)
from offline.logs.checks.samples import (
    Gaps,
    Issue,
    Occupancy,
    Outliers,
    Range,
    find_gaps,
    find_occupancy,
    find_outliers,
    find_ranges,
    gap_issues,
    outlier_issues,
)
from offline.logs.episode import LEAST_SAMPLES, CutDrive
from offline.logs.mapping import LogMapping
from offline.logs.series import LoggedDrive
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.signals import Schema
from rt_controller.mapping.quantity import Quantity
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


OFF_LINE = (
    "periods are too far from the line or beyond its end, or their nearest point jumps; the drive "
    "is cut there. farthest_m in [pose] sets the limit"
)
_CONSTANT_SHARE = 1e-9
"""of its size within which a signal counts as constant"""


def inspect_drives(
    drives: Sequence[LoggedDrive],
    cuts: Sequence[CutDrive],
    slices: Starts,
    part: NDArray[np.int8],
    mapping: LogMapping,
    schema: Schema,
) -> ImportReport:
    """The report on an import.

    Args:
        cuts: one for each drive.
        slices: the windows of all episodes.
        part: (E,) index into `PARTS` of each episode.

    Raises:
        DatasetError: a state or input is constant, or a unit is probably wrong, and the mapping
            does not accept it.
    """
    constant = _require_motion(drives, mapping)
    episodes = [episode for cut in cuts for episode in cut.episodes]
    proportions = find_proportions(episodes, mapping)
    suspected = unit_issues(proportions, episodes, mapping)
    if suspected and not mapping.checks.accept_units:
        listed = (f"  {_where(each.subject, drives)}: {each.message}.\n" for each in suspected)
        raise DatasetError(
            f"expected units as in the mapping, found signals that contradict them:\n"
            f"{''.join(listed)}If all units are correct, write accept_units = true in [checks]."
        )
    outliers = find_outliers(drives)
    shifts, ranges = find_time_shifts(episodes, mapping), find_ranges(episodes, schema)
    files = tuple(_file(drive, cut, mapping) for drive, cut in zip(drives, cuts, strict=True))
    pedals = [n for n in mapping.signals if mapping.quantity(n) in (Quantity.DRIVE, Quantity.BRAKE)]
    return ImportReport(
        period_s=mapping.period_s,
        files=files,
        episodes=tuple(
            EpisodeReport(e.drive, e.begin_s, mapping.period_s * (len(e) - 1), PARTS[k])
            for e, k in zip(episodes, part, strict=True)
        ),
        slices=tuple(np.bincount(part[slices.episode], minlength=len(PARTS)).tolist()),
        ranges=tuple(ranges),
        occupancy=find_occupancy(episodes, mapping),
        outliers=tuple(outliers),
        time_shifts=tuple(shifts),
        proportions=tuple(proportions),
        constant=constant,
        unchecked=find_unchecked(mapping, proportions, ranges),
        issues=(
            *suspected,
            *gap_issues([file.gaps for file in files]),
            *(
                Issue("reference line", file.name, f"{file.off_line} {OFF_LINE}")
                for file in files
                if file.off_line
            ),
            *time_shift_issues(shifts),
            *outlier_issues(outliers, pedals),
            *(Issue("constant", name, "constant, as the mapping allows") for name in constant),
            *_slow(drives, mapping),
        ),
    )


def require_episodes(
    drives: Sequence[LoggedDrive], cuts: Sequence[CutDrive], mapping: LogMapping
) -> None:
    """Raise a `DatasetError` if there is no episode: all stretches are too short."""
    if any(cut.episodes for cut in cuts):
        return
    needed = f"at least {LEAST_SAMPLES} samples at {1e3 * mapping.period_s:g} ms"
    remedy = (
        "Record longer drives, or correct what cuts them: longest_gap_s in [time], keep and "
        "steepest_per_s of the signals, delay_s, the unit of time."
    )
    stretches = [
        (stretch.end_s - stretch.begin_s, drive, stretch.begin_s)
        for drive, cut in zip(drives, cuts, strict=True)
        for stretch in cut.left_out
    ]
    if stretches:
        duration_s, drive, begin_s = max(stretches, key=lambda each: each[0])
        samples = round(duration_s / mapping.period_s) + 1
        series = drive.signals[0]
        place = series.place_of(min(int(np.searchsorted(series.t_s, begin_s)), len(series.row) - 1))
        raise DatasetError(
            f"{place}: expected a stretch without gap of {needed}, found one of {samples} and none "
            f"longer in {len(drives)} logs. {remedy}"
        )
    off_line = sum(cut.off_line for cut in cuts)
    if mapping.pose and off_line:
        raise DatasetError(
            f"{drives[0].name}: expected a drive within {mapping.pose.farthest_m:g} m of "
            f"{mapping.pose.reference_line}, found all {off_line} periods farther away, in "
            f"{len(drives)} logs. Give the line in the frame of the pose and in m, or correct "
            f"farthest_m in [pose]."
        )
    raise DatasetError(
        f"{drives[0].name}: expected a stretch without gap of {needed}, found no time at "
        f"which all signals are known, in {len(drives)} logs. {remedy}"
    )


def _require_motion(drives: Sequence[LoggedDrive], mapping: LogMapping) -> tuple[str, ...]:
    """Names of the signals that are constant over all logs, which the mapping allows."""
    constant = []
    for i, (name, signal) in enumerate(mapping.signals.items()):
        series = [drive.signals[i] for drive in drives]
        low = min(float(each.values.min()) for each in series)
        high = max(float(each.values.max()) for each in series)
        if high - low > _CONSTANT_SHARE * max(abs(low), abs(high)):
            continue
        if not signal.may_be_constant and name not in mapping.exogenous:
            first = series[0]
            raise DatasetError(
                f"{first.place}, {first.of.word}s {first.row[0]} to {first.row[-1]}: expected "
                f"{name} to change, found {low:.6g} {first.unit} all the time, in {len(drives)} "
                f"logs. Remove it from the mapping, name another column, or write may_be_constant "
                f"= true for it."
            )
        constant.append(name)
    return tuple(constant)


def _where(subject: str, drives: Sequence[LoggedDrive]) -> str:
    """The file and its first row, or the column that a signal comes from."""
    for drive in drives:
        if drive.name == subject:
            first = drive.signals[0]
            return f"{first.place}, from {first.of.word} {first.row[0]} on"
        for series in drive.all_series:
            if series.name == subject:
                return series.place
    return subject


def _file(drive: LoggedDrive, cut: CutDrive, mapping: LogMapping) -> FileReport:
    series = drive.all_series
    begin_s, end_s = min(s.t_s[0] for s in series), max(s.t_s[-1] for s in series)
    return FileReport(
        name=drive.name,
        rows=drive.rows,
        duration_s=float(end_s - begin_s),
        slowest_step_s=max(s.usual_step_s for s in series),
        stretches=cut.stretches,
        episodes=len(cut.episodes),
        kept_s=mapping.period_s * sum(len(episode) - 1 for episode in cut.episodes),
        too_short=len(cut.left_out),
        off_line=cut.off_line,
        gaps=find_gaps(drive),
    )


def _slow(drives: Sequence[LoggedDrive], mapping: LogMapping) -> Iterator[Issue]:
    """An issue about the signals that are sampled less often than the data set."""
    step_s = {
        name: max(drive.signals[i].usual_step_s for drive in drives)
        for i, name in enumerate(mapping.signals)
    }
    slow = [name for name in step_s if step_s[name] > 1.01 * mapping.period_s]
    if slow:
        yield Issue(
            "rate",
            ", ".join(slow),
            f"recorded every {1e3 * max(step_s[name] for name in slow):.4g} ms at the slowest, "
            f"interpolated to {1e3 * mapping.period_s:g} ms: nothing faster than the log can be "
            f"learned",
        )
