"""All checks of logs before they become a data set: what is refused, and what is reported.

The report is figures, as `--json` has them, and tables for the terminal.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from offline.config import STEPS
from offline.data.manifest import PARTS
from offline.data.recording import Starts
from offline.logs.episode import LEAST_SAMPLES, CutDrive
from offline.logs.mapping import LogMapping
from offline.logs.relations import Figures, Issue, compare_signals
from offline.logs.signal import LoggedDrive
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.signals import Schema
from rt_controller.mapping.relations import HELP
from rt_controller.report.table import Column, Table, format_number

_CONSTANT_SHARE = 1e-9
"""of its size within which a signal counts as constant"""


def inspect_drives(
    drives: Sequence[LoggedDrive],
    cuts: Sequence[CutDrive],
    slices: Starts,
    part: NDArray[np.int8],
    mapping: LogMapping,
    schema: Schema,
) -> Figures:
    """The figures of an import.

    Args:
        cuts: one for each drive.
        slices: the windows of all episodes.
        part: (E,) index into `PARTS` of each episode.

    Raises:
        DatasetError: a state or input is constant, or a unit is probably wrong, and the mapping
            does not accept it.
    """
    constant = _find_constant(drives, mapping)
    episodes = [episode for cut in cuts for episode in cut.episodes]
    answers, suspected = compare_signals(episodes, mapping)
    wrong_units = [each for each in suspected if each.check == "units"]
    if wrong_units and not mapping.checks.accept_units:
        listed = "".join(f"  {each.subject}: {each.message}.\n" for each in wrong_units)
        raise DatasetError(
            f"expected units and signs as in the mapping, found signals that contradict them:\n"
            f"{listed}{HELP}. If all are correct, write accept_units = true in [checks]."
        )
    files = [_file(drive, cut, mapping) for drive, cut in zip(drives, cuts, strict=True)]
    signals = pd.concat([episode.signals for episode in episodes])
    known = [s for s in (*schema.states, *schema.inputs, *schema.exogenous) if s.name in signals]
    ranges = signals[[s.name for s in known]].quantile([0.0, 0.05, 0.5, 0.95, 1.0]).T
    ranges.columns = pd.Index(["lowest", "q05", "median", "q95", "highest"])
    ranges.insert(0, "name", ranges.index)
    ranges.insert(1, "unit", [signal.unit for signal in known])
    issues = [
        *suspected,
        *_sampling_issues(files, drives, mapping),
        *(Issue("constant", name, "constant, as the mapping allows") for name in constant),
    ]
    counts = np.bincount(part[slices.episode], minlength=len(PARTS)).tolist()
    return {
        "n_rows": sum(file["rows"] for file in files),
        "duration_s": sum(file["duration_s"] for file in files),
        "kept_s": sum(file["kept_s"] for file in files),
        "n_episodes": len(episodes),
        "n_too_short": sum(file["too_short"] for file in files),
        "n_slices": dict(zip(PARTS, counts, strict=True)),
        "period_s": mapping.period_s,
        "files": files,
        "episodes": [
            {
                "file": episode.drive,
                "begin_s": episode.begin_s,
                "duration_s": mapping.period_s * (len(episode) - 1),
                "part": PARTS[k],
            }
            for episode, k in zip(episodes, part, strict=True)
        ],
        "ranges": ranges.to_dict("records"),
        "relations": answers,
        "constant": constant,
        "issues": [issue._asdict() for issue in issues],
    }


def report_tables(figures: Figures) -> Iterator[Table]:
    """Logs, ranges of the signals, and issues."""
    files = pd.DataFrame(figures["files"])
    files.insert(0, "step_ms", 1e3 * files["slowest_step_s"])
    keys = ["name", "rows", "duration_s", "step_ms", "stretches", "episodes", "kept_s"]
    heads = ["log", "rows", "duration, s", "row every, ms", "stretches", "episodes", "kept, s"]
    yield _table("Logs", heads, 1, files[keys].itertuples(index=False))
    heads = ["signal", "unit", "lowest", "5 %", "median", "95 %", "highest"]
    yield _table("Coverage", heads, 2, map(dict.values, figures["ranges"]))
    if figures["issues"]:
        issues = map(dict.values, figures["issues"])
        yield _table("Check these before training", ("check", "subject", "issue"), 3, issues)


def _table(
    title: str, heads: Sequence[str], texts: int, rows: Iterable[Iterable[str | int | float]]
) -> Table:
    """A table whose first columns are texts; a head is "title" or "title, unit"."""
    parts = (head.partition(", ") for head in heads)
    columns = tuple(Column(name, unit, i < texts) for i, (name, _, unit) in enumerate(parts))
    lines = (
        tuple(format_number(c, 3) if isinstance(c, float) else str(c) for c in row) for row in rows
    )
    return Table(title, columns, tuple(lines))


def summary(figures: Figures) -> str:
    """One sentence on episodes and windows, and one on what was not checked."""
    windows = ", ".join(f"{n} {part}" for part, n in figures["n_slices"].items())
    return (
        f"{figures['n_episodes']} episodes, {figures['kept_s']:.0f} s at "
        f"{1e3 * figures['period_s']:g} ms, {figures['n_too_short']} stretches too short and "
        f"left out; windows of {STEPS} steps: {windows}\n"
        f"A unit is checked only where signals depend on each other: compare the ranges with what "
        f"the car did."
    )


def require_episodes(
    drives: Sequence[LoggedDrive], cuts: Sequence[CutDrive], mapping: LogMapping
) -> None:
    """Raise a `DatasetError` if there is no episode: all stretches are too short."""
    if any(cut.episodes for cut in cuts):
        return
    off_line = sum(cut.off_line for cut in cuts)
    stretches = [
        (stretch.end_s - stretch.begin_s, drive.signals[0], stretch.begin_s)
        for drive, cut in zip(drives, cuts, strict=True)
        for stretch in cut.left_out
    ]
    place, longest = drives[0].name, "no time at which all signals are known"
    remedy = (
        "Record longer drives, or correct what cuts them: longest_gap_s in [time], keep and "
        "steepest_per_s of the signals, delay_s, the unit of time"
    )
    if stretches:
        duration_s, signal, begin_s = max(stretches, key=lambda each: each[0])
        place = signal.place_of(min(int(np.searchsorted(signal.t_s, begin_s)), len(signal.row) - 1))
        longest = f"one of {round(duration_s / mapping.period_s) + 1} and none longer"
    elif mapping.pose and off_line:
        near = f"{mapping.pose.farthest_m:g} m of {mapping.pose.reference_line}"
        longest = f"all {off_line} periods not within {near}"
        remedy = "Give the line in the frame of the pose and in m, or correct farthest_m in [pose]"
    raise DatasetError(
        f"{place}: expected a stretch without gap of at least {LEAST_SAMPLES} samples at "
        f"{1e3 * mapping.period_s:g} ms, found {longest}, in {len(drives)} logs. {remedy}."
    )


def _find_constant(drives: Sequence[LoggedDrive], mapping: LogMapping) -> list[str]:
    """Names of the signals that are constant over all logs, which the mapping allows."""
    constant = []
    for i, (name, signal) in enumerate(mapping.signals.items()):
        first = drives[0].signals[i]
        low = min(float(drive.signals[i].values.min()) for drive in drives)
        high = max(float(drive.signals[i].values.max()) for drive in drives)
        if high - low > _CONSTANT_SHARE * max(abs(low), abs(high)):
            continue
        if not signal.may_be_constant and name not in mapping.exogenous:
            raise DatasetError(
                f"{first.column.place}, {first.column.word}s {first.row[0]} to {first.row[-1]}: "
                f"expected {name} to change, found {low:.6g} {first.unit} all the time, in "
                f"{len(drives)} logs. Remove it from the mapping, name another column, or write "
                f"may_be_constant = true for it."
            )
        constant.append(name)
    return constant


def _file(drive: LoggedDrive, cut: CutDrive, mapping: LogMapping) -> Figures:
    """What was made of one log, and the gaps of its signal with the longest ones."""
    signals = drive.all_signals
    worst = max(signals, key=lambda each: each.missing_s)
    first = (
        f"{worst.name}, {worst.column.word} {worst.row[worst.gaps[0] + 1]}" if worst.gaps else ""
    )
    gaps = {"file": drive.name, "number": len(worst.gaps), "missing_s": worst.missing_s}
    return {
        "name": drive.name,
        "rows": drive.rows,
        "duration_s": float(max(s.t_s[-1] for s in signals) - min(s.t_s[0] for s in signals)),
        "slowest_step_s": max(s.usual_step_s for s in signals),
        "stretches": cut.stretches,
        "episodes": len(cut.episodes),
        "kept_s": mapping.period_s * sum(len(episode) - 1 for episode in cut.episodes),
        "too_short": len(cut.left_out),
        "off_line": cut.off_line,
        "gaps": {**gaps, "first": first},
    }


def _sampling_issues(
    files: Sequence[Figures], drives: Sequence[LoggedDrive], mapping: LogMapping
) -> Iterator[Issue]:
    """Issues about gaps, a line that drives leave, jumps, and signals that are sampled slowly."""
    for file in files:
        gaps = file["gaps"]
        if gaps["number"]:
            yield Issue(
                "gaps",
                file["name"],
                f"{gaps['number']} without samples, {gaps['missing_s']:.3g} s in all, the first "
                f"before {gaps['first']}: the drive is cut there. longest_gap_s of [time] or of "
                f"the signal bridges longer ones by linear interpolation",
            )
        if file["off_line"]:
            yield Issue(
                "reference line",
                file["name"],
                f"{file['off_line']} periods are too far from the line or beyond its end, or their "
                f"nearest point jumps; the drive is cut there. farthest_m in [pose] sets the limit",
            )
    for drive in drives:
        for signal in drive.all_signals:
            if signal.column.unusable:
                yield Issue(
                    "no measurement", f"{drive.name}, {signal.name}", signal.column.unusable
                )
    for of_drives in zip(*(drive.all_signals for drive in drives), strict=True):
        jumps = sum(signal.jumps for signal in of_drives)
        if jumps:
            yield Issue(
                "jumps",
                of_drives[0].name,
                f"{jumps} increments are larger than a vehicle can make; the drives are cut "
                f"there. skip_first_s in [time] leaves out filters that settle, steepest_per_s "
                f"sets the limit",
            )
    steps_s = {
        each[0].name: max(signal.usual_step_s for signal in each)
        for each in zip(*(drive.signals for drive in drives), strict=True)
        if each[0].name in mapping.signals
    }
    slow = {name: step_s for name, step_s in steps_s.items() if step_s > 1.01 * mapping.period_s}
    if slow:
        yield Issue(
            "rate",
            ", ".join(slow),
            f"recorded every {1e3 * max(slow.values()):.4g} ms at the slowest, interpolated to "
            f"{1e3 * mapping.period_s:g} ms: nothing faster than the log can be learned",
        )
