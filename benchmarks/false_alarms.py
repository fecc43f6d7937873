"""`python -m benchmarks.false_alarms`: how often a car without a fault is stopped.

Every scenario, and tight bends, are driven in simulated time with friction 0.5 to 1, mass -15 % to
+15 %, grades, bank, side wind, all shipped cars, steps of the wanted speed and of the path, and the
noise and offsets of production sensors, a quarter of the drives without them. Half of the drives
end in a stop that is requested at any time of the scenario. A drive in which a check fails is
driven again without checks: if the car leaves its path there too, the stop is right; else the alarm
is a false one. A car that leaves its path is driven by `stanley` too: if that controller keeps the
path, the car had grip enough.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
from pydantic import TypeAdapter
from rich.console import Console

from benchmarks.conditions import Condition, conditions, disturbed
from offline.commands.options import JsonFile
from rt_controller.config import ControllerConfig
from rt_controller.contract.errors import PlantError
from rt_controller.contract.faults import StopCause
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.quantities import Quantity
from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.table import Drive
from rt_controller.model.artifact import SHIPPED_MODEL
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_planner
from rt_controller.report.table import Column, Table, to_markdown
from rt_controller.safety.checks import CHECKS, Check, Reaction
from rt_controller.session import ControllerSession
from rt_controller.settings import CarSettings
from rt_controller.simulation import drive_in_lockstep
from rt_controller.terminal.command_line import run_command
from sim_bridge.campaign import THIS_MACHINE, Backend, run_campaign
from sim_bridge.scenario import shipped_scenarios

RIVAL = "stanley"
_NO_ALARM = (Reaction.REPORT, Reaction.REFUSE)
OFF_PATH_M = next(c.threshold for c in CHECKS if c.quantity is Quantity.TRACKING_M)
"""from there on TRACKING_LOST is true"""
ZERO_EVENTS_95, PER_EVENT_95 = 3.0, 2.0
"""upper bound, with 95 % confidence, of the expected number of events of which none was seen; what
each event that was seen adds to it"""

BENDS = tuple(
    str(Path(__file__).parent / "scenarios" / f"{name}.toml")
    for name in ("bend_20m", "bend_40m", "bend_60m", "s_bends")
)
app = cyclopts.App(name="python -m benchmarks.false_alarms", version_flags=[])


@dataclass(frozen=True, slots=True)
class DriveResult:
    """Values and failed checks of the supervisor in one drive."""

    condition: Condition
    driven_s: float
    ey_peak_m: float
    unchecked_ey_peak_m: float | None
    """of the same drive without checks; None: no check failed, or that drive had no end"""
    rival_ey_peak_m: float | None
    """of the same drive with `stanley`, without checks; None: not driven, or it had no end"""
    failed_checks: tuple[str, ...]
    largest: dict[str, float]
    """of each quantity, by its name with its unit"""

    @property
    def has_lost_path(self) -> bool:
        """True if a check failed and the car leaves its path without checks too."""
        unchecked_m = self.unchecked_ey_peak_m
        return bool(self.failed_checks) and unchecked_m is not None and unchecked_m > OFF_PATH_M

    @property
    def has_grip(self) -> bool:
        """True if the car leaves its path, and `stanley` keeps it there."""
        rival_m = self.rival_ey_peak_m
        return self.has_lost_path and rival_m is not None and rival_m <= OFF_PATH_M

    @property
    def false_checks(self) -> tuple[str, ...]:
        """The checks that stopped a car which keeps its path without them."""
        return () if self.has_lost_path else self.failed_checks

    def figures(self) -> dict[str, Any]:
        """For a line of JSON."""
        return {**asdict(self), "condition": self.condition._asdict()}


_RESULT = TypeAdapter(DriveResult)


@app.default
def main(
    *,
    model: str | None = None,
    scenarios: tuple[str, ...] = (),
    hours: float = 10.0,
    drives: Path | None = None,
    backend: Backend = THIS_MACHINE,
    json: JsonFile = None,
) -> None:
    """Drive until so many hours are reached, and print the rate of false alarms of each check.

    Args:
        model: name of a shipped model, or folder of a bundle.
        scenarios: names, or paths of .toml files; default: all that are shipped, and tight bends.
        hours: of simulated driving.
        drives: file with one line of JSON for each drive. What it already has is not driven again:
            an interrupted run goes on with the same command.
    """
    require_writable(json)
    require_writable(drives, "--drives")
    bundle = Bundle.load(model)
    tasks = (
        (" ".join(map(str, each)), (each, model))
        for each in conditions(scenarios or (*shipped_scenarios(), *BENDS))
    )
    made_with = {"model_sha256": bundle.sha256}
    results = run_campaign(measure, tasks, backend, drives, made_with, in_order=True)
    found, driven_h = list[DriveResult](), 0.0
    while driven_h < hours:
        each = _RESULT.validate_python(next(results)[1])
        found.append(each)
        driven_h += each.driven_s / 3600.0
        print(f"{driven_h:.3f} h {each.condition} {each.failed_checks}", flush=True)
    results.close()
    if not found:
        return
    figures = figures_of(found)
    table = table_of(figures)
    Console().print(f"{table.title}\n\n{to_markdown(table)}", highlight=False)
    for each in found:
        if each.false_checks:
            print(f"{each.condition}: {each.false_checks}, |e_y| {each.ey_peak_m:.2f} m")
    write_figures(json, {"model_sha256": {model or SHIPPED_MODEL: bundle.sha256}, **figures})


def measure(condition: Condition, model: str | None) -> dict[str, Any]:
    """`DriveResult` of one drive in simulated time, as JSON.

    Values and failed checks in a stop count only if it was requested: another one begins with a
    false alarm, and its consequences are no further ones.
    """
    largest, failed = np.zeros(len(Quantity)), set[str]()

    def note(session: ControllerSession) -> None:
        supervisor, tick = session.supervisor, session.record.result
        if not tick.is_driven or (tick.is_stopping and condition.stop_at_s is None):
            return
        np.maximum(largest, supervisor.values, out=largest)
        if {tick.estimate.alarm, tick.estimate.rejection} != {StopCause.NONE}:
            failing = (c.name for c in supervisor.failing if c.reaction not in _NO_ALARM)
            failed.update(failing)

    drive = _drive(condition, model, after_tick=note)
    unchecked_m = rival_m = None
    with suppress(PlantError):  # such as a car that does not come to rest: not decided
        if failed:
            unchecked_m = round(_drive(condition, model, checks=()).errors.ey_peak_m, 4)
        if unchecked_m is not None and unchecked_m > OFF_PATH_M:
            rival = _drive(condition, model, RIVAL, checks=())
            rival_m = round(rival.errors.ey_peak_m, 4)
    result = DriveResult(
        condition=condition,
        driven_s=PERIOD_S * int(np.sum(drive["mode"] > 0)),
        ey_peak_m=round(drive.errors.ey_peak_m, 4),
        unchecked_ey_peak_m=unchecked_m,
        rival_ey_peak_m=rival_m,
        failed_checks=tuple(sorted(failed)),
        largest={q.name.lower(): round(float(largest[q]), 6) for q in Quantity},
    )
    return result.figures()


def _drive(
    condition: Condition,
    model: str | None,
    controller: str | None = None,
    checks: Sequence[Check] = CHECKS,
    **observed: Any,
) -> Drive:
    config, bundle = ControllerConfig(controller=controller), Bundle.load(model)
    return drive_in_lockstep(
        config,
        bundle,
        build_planner(bundle, config),
        CarSettings(car=condition.car),
        duration_s=condition.stop_at_s,
        scenario=disturbed(condition),
        checks=checks,
        **observed,
    )


def figures_of(found: Sequence[DriveResult]) -> dict[str, Any]:
    """Counts of all drives, and margin and rate of each check that acts while driving."""
    hours, rows = max(sum(each.driven_s for each in found) / 3600.0, 1e-9), []
    sound = [each for each in found if not each.has_lost_path]
    for check in CHECKS:
        if check.reaction in _NO_ALARM:
            continue
        quantity = check.quantity.name.lower()
        largest = max((each.largest[quantity] for each in sound), default=0.0)
        count = sum(check.name in each.false_checks for each in found)
        rows.append(
            {
                "check": check.name,
                "threshold": check.threshold,
                "quantity": quantity,
                "largest": largest,
                "largest_share_of_threshold": round(largest / check.threshold, 3),
                "drives_with_false_alarm": count,
                "false_alarms_per_h": count / hours,
                "false_alarms_per_h_95_upper": (ZERO_EVENTS_95 + PER_EVENT_95 * count) / hours,
            }
        )
    false = [each.figures() for each in found if each.false_checks]
    return {
        "driven_h": hours,
        "drives": len(found),
        "drives_with_false_alarm": len(false),
        "drives_that_lose_the_path_without_checks_too": len(found) - len(sound),
        "drives_that_lose_the_path_where_stanley_keeps_it": sum(each.has_grip for each in found),
        "checks": rows,
        "false_alarms": false,
    }


def table_of(figures: dict[str, Any]) -> Table:
    """The checks, for reading."""
    columns = {
        "check": ("check", "{}"),
        "threshold": ("threshold", "{:g}"),
        "largest": ("largest", "{:.4g}"),
        "largest_share_of_threshold": ("share", "{:.2f}"),
        "drives_with_false_alarm": ("false alarms", "{}"),
        "false_alarms_per_h_95_upper": ("per hour, 95 % bound", "{:.2g}"),
    }
    heads = tuple(Column(head) for head, _ in columns.values())
    rows = (
        tuple(form.format(each[key]) for key, (_, form) in columns.items())
        for each in figures["checks"]
    )
    title = (
        "{driven_h:.2f} h of driving, {drives} drives, {drives_with_false_alarm} with a false "
        "alarm; {drives_that_lose_the_path_without_checks_too} left the path, with checks and "
        "without, {drives_that_lose_the_path_where_stanley_keeps_it} of them where stanley keeps it"
    ).format(**figures)
    return Table(title, heads, tuple(rows))


if __name__ == "__main__":
    run_command(app)
