"""Looking at logs before they become a data set: what is refused, and what is reported."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from offline.dataset import PARTS
from offline.logs.coverage import find_occupancy, find_ranges
from offline.logs.episode import LEAST_SAMPLES, Cut, Episode
from offline.logs.finding import Finding
from offline.logs.gap import find_gaps
from offline.logs.gap import remarks as remarks_on_gaps
from offline.logs.mapping import Mapping
from offline.logs.outliers import find_outliers
from offline.logs.outliers import remarks as remarks_on_outliers
from offline.logs.quantity import Quantity
from offline.logs.report import EpisodeReport, FileReport, ImportReport
from offline.logs.series import Drive
from offline.logs.time_shift import find_time_shifts
from offline.logs.time_shift import remarks as remarks_on_shifts
from offline.logs.unit_check import Proportion, find_proportions
from offline.logs.unit_check import remarks as remarks_on_units
from offline.recording import Starts
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.schema import Schema

_SAME = 1e-9
"""share of its size within which a signal counts as constant"""


def require_motion(drives: Sequence[Drive], mapping: Mapping) -> tuple[str, ...]:
    """Names of the signals that never move in any log, all of which the mapping allows.

    Raises:
        DatasetError: a state or input is constant and the mapping does not say that it may be.
    """
    constant = []
    for i, (name, signal) in enumerate(mapping.signals.items()):
        series = [drive.signals[i] for drive in drives]
        low = min(float(each.values.min()) for each in series)
        high = max(float(each.values.max()) for each in series)
        if high - low > _SAME * max(abs(low), abs(high)):
            continue
        if not signal.may_be_constant and name not in mapping.exogenous:
            drive, rows = drives[0], series[0].row
            raise DatasetError(
                f"{drive.path}, column {signal.column}, {drive.row_word}s {rows[0]} to "
                f"{rows[-1]}: expected {name} to move, found {low:.6g} {series[0].unit} all the "
                f"time, in {len(drives)} logs. Take it out of the mapping, name another column, "
                f"or write may_be_constant = true for it."
            )
        constant.append(name)
    return tuple(constant)


def require_episodes(drives: Sequence[Drive], cuts: Sequence[Cut], mapping: Mapping) -> None:
    """Return if any episode is left.

    Raises:
        DatasetError: all stretches are too short.
    """
    if any(cut.episodes for cut in cuts):
        return
    longest = max(
        (
            (stretch.end_s - stretch.begin_s, drive, stretch)
            for drive, cut in zip(drives, cuts, strict=True)
            for stretch in cut.left_out
        ),
        default=None,
        key=lambda each: each[0],
    )
    needed = f"at least {LEAST_SAMPLES} samples at {1e3 * mapping.period_s:g} ms"
    remedy = (
        "Record longer drives, or correct what cuts them: longest_gap_s in [time], keep and "
        "steepest_per_s of the signals, delay_s, the unit of time."
    )
    off_line = sum(cut.off_line for cut in cuts)
    if longest is None and mapping.pose and off_line:
        raise DatasetError(
            f"{drives[0].path}: expected a drive within {mapping.pose.farthest_m:g} m of "
            f"{mapping.pose.reference_line}, found all {off_line} periods farther away, in "
            f"{len(drives)} logs. Give the line in the frame of the pose and in m, or correct "
            f"farthest_m in [pose]."
        )
    if longest is None:
        raise DatasetError(
            f"{drives[0].path}: expected a stretch without gap of {needed}, found no time at "
            f"which all signals are known, in {len(drives)} logs. {remedy}"
        )
    duration_s, drive, stretch = longest
    samples = round(duration_s / mapping.period_s) + 1
    raise DatasetError(
        f"{drive.path}, {_row_at(drive, stretch.begin_s)}: expected a stretch without gap of "
        f"{needed}, found one of {samples} and none longer in {len(drives)} logs. {remedy}"
    )


def require_units(
    episodes: Sequence[Episode], mapping: Mapping, schema: Schema, drives: Sequence[Drive]
) -> tuple[list[Proportion], list[Finding]]:
    """The proportions between signals, and suspicions about units that the mapping accepts.

    Raises:
        DatasetError: there is a suspicion, and the mapping does not accept it.
    """
    proportions = find_proportions(episodes, mapping, schema)
    suspicions = remarks_on_units(proportions, episodes, mapping, schema)
    if suspicions and not mapping.checks.accept_units:
        listed = "\n".join(f"  {_where(each, drives)}: {each.says}." for each in suspicions)
        raise DatasetError(
            f"expected units as the mapping says, found signals that contradict each other:\n"
            f"{listed}\nIf all of it is right as it is, write accept_units = true in [checks]."
        )
    return proportions, suspicions


def inspect(
    drives: Sequence[Drive],
    cuts: Sequence[Cut],
    slices: Starts,
    part: NDArray[np.int8],
    mapping: Mapping,
    schema: Schema,
) -> ImportReport:
    """The report on an import.

    Raises:
        DatasetError: as `require_motion` and `require_units` do.
    """
    constant = require_motion(drives, mapping)
    episodes = [episode for cut in cuts for episode in cut.episodes]
    proportions, suspicions = require_units(episodes, mapping, schema, drives)
    outliers = find_outliers(drives)
    shifts = find_time_shifts(episodes, mapping, schema)
    in_part = np.bincount(part[slices.episode], minlength=len(PARTS))
    files = tuple(_file(d, c, mapping) for d, c in zip(drives, cuts, strict=True))
    return ImportReport(
        period_s=mapping.period_s,
        files=files,
        episodes=tuple(
            EpisodeReport(e.path.name, e.begin_s, mapping.period_s * (len(e.x) - 1), PARTS[part[i]])
            for i, e in enumerate(episodes)
        ),
        slices=(int(in_part[0]), int(in_part[1]), int(in_part[2])),
        ranges=tuple(find_ranges(episodes, schema)),
        occupancy=find_occupancy(episodes, mapping, schema),
        outliers=tuple(outliers),
        time_shifts=tuple(shifts),
        proportions=tuple(proportions),
        constant=constant,
        findings=(
            *suspicions,
            *remarks_on_gaps([file.gaps for file in files]),
            *_off_line(files),
            *remarks_on_shifts(shifts),
            *remarks_on_outliers(outliers, _pedals(mapping)),
            *(Finding("constant", name, "never moves, as the mapping allows") for name in constant),
            *_slow(drives, mapping),
        ),
    )


def _file(drive: Drive, cut: Cut, mapping: Mapping) -> FileReport:
    series = drive.all_series
    begin_s, end_s = min(s.t_s[0] for s in series), max(s.t_s[-1] for s in series)
    kept = sum(len(episode.x) - 1 for episode in cut.episodes)
    return FileReport(
        name=drive.path.name,
        rows=drive.rows,
        duration_s=float(end_s - begin_s),
        slowest_step_s=max(s.usual_step_s for s in series),
        stretches=cut.stretches,
        episodes=len(cut.episodes),
        kept_s=mapping.period_s * kept,
        too_short=len(cut.left_out),
        off_line=cut.off_line,
        gaps=find_gaps(drive),
    )


def _pedals(mapping: Mapping) -> list[str]:
    feet = (Quantity.DRIVE, Quantity.BRAKE)
    return [name for name in mapping.signals if mapping.quantity(name) in feet]


def _off_line(files: Sequence[FileReport]) -> list[Finding]:
    return [
        Finding(
            "reference line",
            file.name,
            f"{file.off_line} periods are too far from the line or beyond its end, or their "
            f"nearest point leaps; the drive is cut there. farthest_m in [pose] sets the limit",
        )
        for file in files
        if file.off_line
    ]


def _slow(drives: Sequence[Drive], mapping: Mapping) -> list[Finding]:
    """Signals that were recorded more seldom than the data set has samples."""
    slow = {
        name: max(drive.signals[i].usual_step_s for drive in drives)
        for i, name in enumerate(mapping.signals)
    }
    slow = {name: step_s for name, step_s in slow.items() if step_s > 1.01 * mapping.period_s}
    if not slow:
        return []
    says = (
        f"recorded every {1e3 * max(slow.values()):.4g} ms at the slowest, interpolated to "
        f"{1e3 * mapping.period_s:g} ms: nothing faster than the log can be learned"
    )
    return [Finding("rate", ", ".join(slow), says)]


def _row_at(drive: Drive, time_s: float) -> str:
    series = drive.signals[0]
    k = min(int(np.searchsorted(series.t_s, time_s)), len(series.row) - 1)
    return f"column {series.column}, {drive.row_word} {series.row[k]}"


def _where(suspicion: Finding, drives: Sequence[Drive]) -> str:
    """The file and its first row, or the columns that a signal comes from."""
    for drive in drives:
        if drive.path.name == suspicion.subject:
            return f"{drive.path}, from {drive.row_word} {drive.signals[0].row[0]} on"
        for series in drive.all_series:
            if series.name == suspicion.subject:
                return f"{drive.path}, column {series.column}"
    return suspicion.subject
