"""One drive without a fault: the largest value of each quantity, and the checks that failed."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.false_alarms.conditions import Condition, disturbed
from rt_controller.config import ControllerConfig
from rt_controller.contract.errors import PlantError
from rt_controller.contract.faults import StopCause
from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.table import Drive
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_mpc
from rt_controller.safety.checks import CHECKS, Check, Quantity, Reaction
from rt_controller.session import ControllerSession
from rt_controller.settings import CarSettings
from rt_controller.simulation import drive_in_lockstep

OFF_PATH_M = next(c.threshold for c in CHECKS if c.quantity is Quantity.TRACKING_M)
"""from there on TRACKING_LOST is true"""


@dataclass(frozen=True, slots=True)
class DriveResult:
    """Values and failed checks of the supervisor in one drive."""

    condition: Condition
    driven_s: float
    ey_peak_m: float
    unchecked_ey_peak_m: float | None
    """of the same drive without checks; None: no check failed, or that drive had no end"""
    failed_checks: tuple[str, ...]
    largest: dict[str, float]
    """of each quantity, by its name with its unit"""

    @property
    def has_lost_path(self) -> bool:
        """True if a check failed and the car leaves its path without checks too."""
        unchecked_m = self.unchecked_ey_peak_m
        return bool(self.failed_checks) and unchecked_m is not None and unchecked_m > OFF_PATH_M

    @property
    def false_checks(self) -> tuple[str, ...]:
        """The checks that stopped a car which keeps its path without them."""
        return () if self.has_lost_path else self.failed_checks

    def figures(self) -> dict[str, Any]:
        """For a line of JSON."""
        return {**asdict(self), "condition": self.condition._asdict()}


def result_from(figures: dict[str, Any]) -> DriveResult:
    """The drive of a line of JSON."""
    condition, failed = Condition(**figures["condition"]), tuple(figures["failed_checks"])
    return DriveResult(**{**figures, "condition": condition, "failed_checks": failed})


class _Watch:
    """The largest values and the failing checks of the supervisor of a drive.

    Those in a stop count only if it was requested: another one begins with a false alarm, and its
    consequences are no further ones.
    """

    def __init__(self, is_stop_requested: bool) -> None:
        self._is_stop_requested = is_stop_requested
        self.largest, self.failed = np.zeros(len(Quantity)), set[str]()

    def note(self, session: ControllerSession) -> None:
        """After a tick."""
        supervisor, tick = session._supervisor, session._step.last
        if not tick.is_driven or (tick.is_stopping and not self._is_stop_requested):
            return
        np.maximum(self.largest, supervisor.values, out=self.largest)
        if {tick.estimate.alarm, tick.estimate.rejection} != {StopCause.NONE}:
            failing = (c.name for c in supervisor.failing if c.reaction is not Reaction.REFUSE)
            self.failed.update(failing)


def measure(condition: Condition, model: str | None) -> DriveResult:
    """One drive in simulated time."""
    watch = _Watch(condition.stop_at_s is not None)
    drive = _drive(condition, model, watch)
    return DriveResult(
        condition=condition,
        driven_s=PERIOD_S * int(np.sum(drive["mode"] > 0)),
        ey_peak_m=round(drive.errors.ey_peak_m, 4),
        unchecked_ey_peak_m=_unchecked_ey_peak_m(condition, model) if watch.failed else None,
        failed_checks=tuple(sorted(watch.failed)),
        largest={q.name.lower(): round(float(watch.largest[q]), 6) for q in Quantity},
    )


def _drive(
    condition: Condition, model: str | None, watch: _Watch, checks: Sequence[Check] = CHECKS
) -> Drive:
    config, bundle = ControllerConfig(), Bundle.load(model)
    return drive_in_lockstep(
        config,
        bundle,
        build_mpc(bundle, config.mpc),
        CarSettings(car=condition.car),
        duration_s=condition.stop_at_s,
        scenario=disturbed(condition),
        checks=checks,
        after_tick=watch.note,
    )


def _unchecked_ey_peak_m(condition: Condition, model: str | None) -> float | None:
    try:
        return round(_drive(condition, model, _Watch(False), checks=()).errors.ey_peak_m, 4)
    except PlantError:  # such as a car that does not come to rest: not decided
        return None
