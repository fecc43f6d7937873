"""`rt-controller report LOG`: a page about a whole recorded drive, or about two side by side."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, replace
from math import isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from threadpoolctl import threadpool_limits

from rt_controller.bus.messages import STATE
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.faults import FAULT_SENTENCES, Fault
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.names import label_paths
from rt_controller.contract.signals import InputColumn, Mode
from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.table import Drive, PredictedPath
from rt_controller.drive.trace import DriveTrace
from rt_controller.loop import EndConditions, Ending, RunRecord
from rt_controller.realtime.timing import DeadlineAccount, LateCause, TickTimes
from rt_controller.recording.replay import (
    RecordedDrive,
    Replay,
    ReplayedTick,
    differences,
    read_recorded_drive,
)
from rt_controller.report.drive_page import ReportedDrive, compared_figures, drive_page
from rt_controller.report.overlay import Curve, curves_of
from rt_controller.report.page import require_report_extra, save_page
from rt_controller.safety.tick import Tick
from rt_controller.simulation import predicted_path
from rt_controller.terminal.progress import announce
from rt_controller.terminal.stop_message import (
    VEHICLE_KNOWS,
    Margin,
    exceeded,
    explain_stop,
    plausibility_margins,
)
from rt_controller.terminal.summary import fault_sentences, record_to_json, verdict, why_late

if TYPE_CHECKING:
    from rt_controller.terminal.options import ReportOptions


def report_at_terminal(logs: Sequence[Path], options: "ReportOptions") -> int:
    """Write the page about one or two logs, print its headline; the exit code of the program."""
    require_report_extra("rt-controller report")
    page_file = options.output or logs[0].with_suffix(".html")
    require_writable(page_file, "--output", suffix=".html")
    require_writable(options.json_file, inputs=logs)
    names = label_paths(logs, "report")
    recorded = [read_recorded_drive(log) for log in logs]
    if page_file.exists() and not options.overwrite:
        raise ConfigError(
            f"{page_file}: expected no page of that name yet, found one, which is left as it is. "
            f"Name another file with --output; --overwrite replaces it."
        )
    drives = []
    with threadpool_limits(1, "blas"):
        for name, each in zip(names, recorded, strict=True):
            with (
                announce(f"replaying {each.path}", options.quiet),
                closing(Replay(each, options.model)) as it,
            ):
                drives.append(_Account(name, each, it).reported())
    with announce("drawing", options.quiet):
        written = save_page(drive_page(drives), page_file, "--output")
    for drive in drives:
        named = f"{drive.name}: " if len(drives) > 1 else ""
        Console().print(
            named + drive.figures["headline"][0], highlight=False, markup=False, soft_wrap=True
        )
    print(written)
    write_figures(options.json_file, compared_figures(drives))
    return 0


class _Account:
    """What is collected while a drive is replayed.

    Mode, cause, command and faults are those of the journal, also where this program computes
    others; the values of the checks and the predictions are computed again.
    """

    def __init__(self, name: str, recorded: RecordedDrive, replay: Replay) -> None:
        self._name, self._recorded, self._replay = name, recorded, replay
        n_ticks = len(recorded.driven)
        if n_ticks == 0:
            raise ConfigError(
                f"{recorded.path}: expected a drive, found no tick in its journal: it ended before "
                f"the first one. Choose another log."
            )
        deadline_ns = round(1e6 * replay.config.realtime.deadline_ms)
        self._record = RunRecord(DeadlineAccount(n_ticks, deadline_ns), DriveTrace(n_ticks))
        self._ticks: list[Tick] = []
        self._values: list[list[float]] = []
        self._failed: list[Margin] = []
        """checks beyond their limit when the last safe stop began"""
        self._ages_ms: list[float] = []
        self._horizons: list[PredictedPath] = []
        self._differing = 0

    def reported(self) -> ReportedDrive:
        """Replay the drive; the plain data of its page."""
        record, end, is_over = self._record, EndConditions(self._record, False), False
        for tick in self._replay.ticks():
            if tick.recorded.tick >= 0:
                self._add(tick)
                is_stopping = any(call.name == "request_stop" for call in tick.recorded.calls)
                is_over = end.are_met(record.result, is_stopping)
        if not is_over and record.result.mode is not Mode.STANDBY:
            is_cut = self._recorded.ends_in_drive
            record.ending = Ending.LOG_ENDED if is_cut else Ending.ENDED_AT_ONCE
        header, path = self._recorded.header, self._recorded.path
        drive = record.trace.drive(header.model["name"], record.ending.value)
        places = drive["s_m"]
        horizons = (each._replace(s_m=each.s_m + places[each.tick]) for each in self._horizons)
        drive = replace(drive, stop_tick=record.stop_tick, horizons=tuple(horizons))
        curves, times_s = self._curves(drive), drive["time_s"].tolist()
        checks = self._checks(curves, times_s)
        figures = {
            "log": str(path),
            "model": header.model,
            "recorded_with": header.packages,
            "ticks_with_other_command": self._differing,
            **record_to_json(record),
            "stop_checks": [each._asdict() for each in self._failed],
            "log_frames_dropped": self._recorded.driven[-1].dropped,
            "state_age_ms": _quantiles(self._ages_ms),
            "frames_received": asdict(self._replay.node.inbox.counts),
            "headline": list(self._headline()),
            "notes": list(self._notes()),
            "events": _events(self._ticks, times_s),
            "checks": sorted(checks, key=lambda each: -each["share_percent"]),
        }
        return ReportedDrive(self._name, drive, curves, figures)

    def _add(self, tick: ReplayedTick) -> None:
        then, node, record = tick.recorded, self._replay.node, self._record
        self._differing += bool(differences(tick))
        result = replace(tick.result, mode=then.mode, cause=then.cause, faults=Fault(then.faults))
        if then.control is not None:
            result = replace(result, control=then.control)
        times = TickTimes(*(then.times.get(name, 0.0) for name in TickTimes._fields))
        cause = next((each for each in LateCause if each.value == then.late_cause), None)
        record.deadlines.record(times, then.skipped, round(1e3 * then.sent_after_us), cause)
        record.add(result, then.scheduled_ns)
        number, values = record.trace.last_tick, list(node.supervisor.values)
        if number == record.stop_tick:
            failed = exceeded(plausibility_margins(values, node.supervisor.checks))
            self._failed = failed if result.cause.is_of_checks else []
        self._horizons += predicted_path(self._replay.planner, number)
        age_ns = node.step.state_age_ns(then.began_ns)
        self._ages_ms.append(nan if age_ns is None else age_ns * 1e-6)
        self._values.append(values)
        self._ticks.append(result)

    def _headline(self) -> Iterator[str]:
        """What happened, then when, why and what to do, as the summary of a drive says it."""
        record, inbox = self._record, self._replay.node.inbox
        state = inbox.newest(STATE)
        is_braking = state is not None and state.content.is_watchdog_braking
        braking = VEHICLE_KNOWS if is_braking else ""
        yield verdict(record, braking=braking)
        cause, bus_fault = record.result.cause, record.result.bus_fault
        if record.ending is Ending.SAFE_STOPPED:
            why = explain_stop(cause, inbox, (), bus_fault, self._failed, braking)
            yield f"Safe stop at {record.stop_s:.3f} s (tick {record.stop_tick}): {why}"
        yield from fault_sentences(record)
        if record.deadlines.deadline_misses:
            yield f"Late: {why_late(record.deadlines)}."

    def _notes(self) -> Iterator[str]:
        """What limits the page."""
        changed = self._recorded.header.changed_versions()
        if changed:
            yield f"Recorded by other versions: {', '.join(changed)}."
        if self._differing:
            yield (
                f"This program computes another command in {self._differing} ticks. Commands, "
                f"modes and faults of this page are those of the journal; values of the checks "
                f"and predictions are computed again and may differ from those of the drive. Use "
                f"the version that recorded it to see what happened."
            )
        missing_from = self._recorded.incomplete_from
        if missing_from is not None:
            yield (
                f"Frames are missing in the log from tick {missing_from} on: the queue or the disk "
                f"was full. What is computed again from there on may differ; record to a disk "
                f"with more room."
            )

    def _curves(self, drive: Drive) -> dict[str, Curve]:
        """Those of each drive with their bounds, the time of the step, and those of the checks."""
        is_driven = (drive["mode"] != Mode.STANDBY)[:, None]
        rows = zip(*((t.limits.upper, t.limits.rate_per_s) for t in self._ticks), strict=True)
        upper, rates = (np.where(is_driven, np.array(each), nan) for each in rows)
        values = np.where(is_driven, np.array(self._values), nan)
        step_us = self._record.deadlines.last()[:, TickTimes._fields.index("step_us")]
        curves = {**curves_of(drive), "step": Curve("µs", step_us)}
        for check in self._replay.node.supervisor.checks:
            quantity, threshold = check.quantity, np.full(len(drive), check.threshold)
            curve = Curve(quantity.unit, values[:, quantity], bound=threshold)
            curves[f"check: {check.name}"] = curve
        for name, bound in (
            ("lateral error", curves["check: tracking"].bound),
            ("steering wheel", np.degrees(upper[:, InputColumn.steer_rad])),
            ("wheel rate", np.degrees(rates[:, InputColumn.steer_rad])),
            ("throttle", upper[:, InputColumn.throttle]),
            ("brake", upper[:, InputColumn.brake_n]),
        ):
            curves[name] = curves[name]._replace(bound=bound)
        return curves

    def _checks(
        self, curves: Mapping[str, Curve], times_s: Sequence[float]
    ) -> Iterator[dict[str, Any]]:
        """The largest value of each check that compared something."""
        for check in self._replay.node.supervisor.checks:
            values = curves[f"check: {check.name}"].values
            if np.isnan(values).all():
                continue
            at = int(np.nanargmax(values))
            yield {
                "check": check.name,
                "largest": float(values[at]),
                "threshold": check.threshold,
                "unit": check.quantity.unit,
                "share_percent": round(100.0 * float(values[at]) / check.threshold),
                "at_s": times_s[at],
                "window_ticks": check.window_ticks,
            }


def _quantiles(ages_ms: Sequence[float]) -> dict[str, float | None]:
    known = [age for age in ages_ms if not isnan(age)]
    if not known:
        return {"p50": None, "max": None}
    return {"p50": float(np.median(known)), "max": max(known)}


def _events(ticks: Sequence[Tick], times_s: Sequence[float]) -> list[dict[str, Any]]:
    """When the plan was held, the car was stopped, and each bit of the heartbeat was set."""
    found, lasting = list[dict[str, Any]](), dict[tuple[str, str], dict[str, Any]]()
    for tick, begin_s in zip(ticks, times_s, strict=True):
        now = [
            (f"{fault.name}", why) for fault, why in FAULT_SENTENCES.items() if fault in tick.faults
        ]
        if tick.mode in (Mode.HOLD_PLAN, Mode.SAFE_STOP):
            now.insert(0, (tick.mode.name, tick.cause.value))
        new = {
            key: {"name": key[0], "why": key[1], "begin_s": begin_s, "ticks": 0}
            for key in now
            if key not in lasting
        }
        found += new.values()
        lasting = {key: lasting.get(key) or new[key] for key in now}
        for event in lasting.values():
            event |= {"end_s": begin_s + PERIOD_S, "ticks": event["ticks"] + 1}
    return found
