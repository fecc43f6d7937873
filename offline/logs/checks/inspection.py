"""All checks of logs before they become a data set: what is refused, and what is reported."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from offline.data.dataset import PARTS
from offline.data.recording import Starts
from offline.logs.checks.coverage import find_occupancy, find_ranges
from offline.logs.checks.pairs import (
    find_proportions,
    find_time_shifts,
    find_unchecked,
    time_shift_issues,
    unit_issues,
)
from offline.logs.checks.samples import (
    Issue,
    find_gaps,
    find_outliers,
    gap_issues,
    outlier_issues,
)
from offline.logs.episode import LEAST_SAMPLES, CutDrive
from offline.logs.mapping import LogMapping
from offline.logs.report import EpisodeReport, FileReport, ImportReport
from offline.logs.series import LoggedDrive
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.schema import Schema
from rt_controller.mapping.quantity import Quantity

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
    _require_units(suspected, mapping, drives)
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
            *_off_line(files),
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
                f"{first.place}, {first.row_word}s {first.row[0]} to {first.row[-1]}: expected "
                f"{name} to change, found {low:.6g} {first.unit} all the time, in {len(drives)} "
                f"logs. Remove it from the mapping, name another column, or write may_be_constant "
                f"= true for it."
            )
        constant.append(name)
    return tuple(constant)


def _require_units(
    suspected: Sequence[Issue], mapping: LogMapping, drives: Sequence[LoggedDrive]
) -> None:
    """Raise a `DatasetError` if units are suspected and the mapping does not accept them."""
    if suspected and not mapping.checks.accept_units:
        listed = "\n".join(
            f"  {_where(each.subject, drives)}: {each.message}." for each in suspected
        )
        raise DatasetError(
            f"expected units as in the mapping, found signals that contradict them:\n"
            f"{listed}\nIf all units are correct, write accept_units = true in [checks]."
        )


def _where(subject: str, drives: Sequence[LoggedDrive]) -> str:
    """The file and its first row, or the column that a signal comes from."""
    for drive in drives:
        if drive.name == subject:
            first = drive.signals[0]
            return f"{first.place}, from {first.row_word} {first.row[0]} on"
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


def _off_line(files: Sequence[FileReport]) -> list[Issue]:
    message = (
        "periods are too far from the line or beyond its end, or their nearest point jumps; the "
        "drive is cut there. farthest_m in [pose] sets the limit"
    )
    off_line = [file for file in files if file.off_line]
    return [Issue("reference line", file.name, f"{file.off_line} {message}") for file in off_line]


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
