"""Checks of one tick with their values, limits and margins."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from rt_controller.bus.messages import MISSION, PREVIEW, REFERENCE, Message
from rt_controller.bus.receive import Inbox
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import INPUT_UNITS, ControlInput
from rt_controller.contract.timing import PERIOD_S
from rt_controller.safety.checks import CHECKS, is_computed
from rt_controller.safety.freshness import (
    REFERENCE_MAX_AGE_NS,
    STATE_MAX_AGE_NS,
    TIMING_SLACK_NS,
)

_MS = 1e-6
_UNITS = {
    "M": "m",
    "MPS": "m/s",
    "MPS2": "m/s^2",
    "MPS3": "m/s^3",
    "RAD": "rad",
    "RADPS": "rad/s",
    "N": "N",
    "TICKS": "ticks",
}
"""by the end of the name of a quantity"""


class Margin(NamedTuple):
    """A quantity that a check compares with its limit."""

    check: str
    value: float | None
    """None: there is nothing to check, which is a fault of its own where the check needs it"""
    limit: float
    unit: str

    @property
    def margin(self) -> float | None:
        """Limit minus value; negative if the value is beyond the limit."""
        return None if self.value is None else self.limit - self.value

    @property
    def text(self) -> str:
        """Check, value and limit for people."""
        value = "nothing to check" if self.value is None else f"{self.value:.4g}"
        return f"{self.check}, {value} of {self.limit:.4g} {self.unit}"


def data_margins(inbox: Inbox, now_ns: int, state_age_ns: int | None) -> list[Margin]:
    """Ages of what was received, at the beginning of a tick."""
    mission = inbox.newest(MISSION)
    valid_for_ns = 0 if mission is None else mission.content.valid_for_ns
    path_limit_ms = (REFERENCE_MAX_AGE_NS + TIMING_SLACK_NS) * _MS
    ages_ns = [
        ("age of the state, with its transport", state_age_ns, STATE_MAX_AGE_NS * _MS),
        ("age of the path", _age_ns(inbox, REFERENCE, now_ns), path_limit_ms),
        ("age of the curvature ahead", _age_ns(inbox, PREVIEW, now_ns), path_limit_ms),
        (
            "age of the mission",
            _age_ns(inbox, MISSION, now_ns),
            (valid_for_ns + TIMING_SLACK_NS) * _MS,
        ),
    ]
    return [
        Margin(name, None if age is None else age * _MS, limit_ms, "ms")
        for name, age, limit_ms in ages_ns
    ]


def plausibility_margins(values: Sequence[float]) -> list[Margin]:
    """The quantities of a tick, by `Quantity`, against the thresholds of the table of checks."""
    margins = []
    for check in CHECKS:
        value = values[check.quantity]
        unit = _unit_of(check.quantity.name)
        margins.append(
            Margin(check.name, value if is_computed(value) else None, check.threshold, unit)
        )
    return margins


def exceeded(margins: Iterable[Margin]) -> list[Margin]:
    """Those whose value is beyond its limit; some checks act only after several ticks in a row."""
    return [each for each in margins if each.value is not None and each.value > each.limit]


def command_margins(
    control: ControlInput, previous: ControlInput, most_steer_rad: float
) -> list[Margin]:
    """The command of a tick against its bounds and rates; the envelope keeps it within them."""
    upper = INPUT_LIMITS.upper._replace(steer_rad=most_steer_rad)
    rates = INPUT_LIMITS.rate_per_s
    sizes = [
        Margin(f"size of {name}", abs(value), bound, unit)
        for name, value, bound, unit in zip(
            control._fields, control, upper, INPUT_UNITS, strict=True
        )
    ]
    # A throttle that closes is not limited.
    changes = [
        Margin(f"change of {name} in this period", abs(now - before), rate * PERIOD_S, unit)
        for name, now, before, rate, unit in zip(
            control._fields, control, previous, rates, INPUT_UNITS, strict=True
        )
        if not (name == "throttle" and now < before)
    ]
    return [*sizes, *changes]


def _unit_of(quantity: str) -> str:
    if quantity.endswith("_PER_M"):
        return "1/m"
    return _UNITS.get(quantity.rsplit("_", 1)[-1], "1")


def _age_ns(inbox: Inbox, message: Message[Any], now_ns: int) -> int | None:
    newest = inbox.newest(message)
    return None if newest is None else now_ns - newest.arrival_ns
