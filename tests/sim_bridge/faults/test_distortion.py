"""The values that a fault of signals leaves, at the steering wheel."""

from typing import Any

import can
import pytest

from rt_controller.contract.signals import NEUTRAL_INPUT
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.faults.bus import FaultyBus
from sim_bridge.faults.fault import Fault


def distorted(fields: dict[str, Any], ticks: range, values: list[float]) -> list[float]:
    """The angle, tick by tick; `ticks` are those of the fault."""
    start_s, duration_s = ticks.start * PERIOD_S, len(ticks) * PERIOD_S
    signals = ("ACTUATOR.steer_rad",)
    fault = Fault(signals=signals, start_s=start_s, duration_s=duration_s, **fields)
    with can.Bus(interface="virtual", channel="distortion") as bus:
        actuators = FaultyBus(bus, [fault])
        found = [
            actuators.actuated(NEUTRAL_INPUT._replace(brake_n=10.0, steer_rad=value), tick)
            for tick, value in enumerate(values)
        ]
    assert {each.brake_n for each in found} == {10.0}, "the other values are not changed"
    return [each.steer_rad for each in found]


RAMP = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
LAG_2, LAG_9 = 2 * PERIOD_S, 9 * PERIOD_S


@pytest.mark.parametrize(
    ("fields", "ticks", "expected"),
    [
        ({"kind": "freeze"}, range(2, 5), [0, 1, 2, 2, 2, 5]),
        ({"kind": "lag", "delay_s": LAG_2}, range(2, 5), [0, 1, 0, 1, 2, 5]),
        ({"kind": "lag", "delay_s": LAG_9}, range(1, 3), [0, 0, 0, 3, 4, 5]),
        ({"kind": "scale", "value": -1.0}, range(2, 4), [0, 1, -2, -3, 4, 5]),
        ({"kind": "bias", "value": 0.5}, range(2, 4), [0, 1, 2.5, 3.5, 4, 5]),
        ({"kind": "drift", "value": 4.0}, range(2, 5), [0, 1, 2.1, 3.2, 4.3, 5]),
        ({"kind": "quantise", "value": 2.0}, range(1, 6), [0, 0, 2, 4, 4, 4]),
        ({"kind": "set", "value": 9.0}, range(4, 9), [0, 1, 2, 3, 9, 9]),
        ({"kind": "rate", "value": 20.0}, range(2, 5), [0, 1, 1.5, 2, 2.5, 5]),
        ({"kind": "rate", "value": 80.0}, range(2, 5), [0, 1, 2, 3, 4, 5]),
        ({"kind": "stuck"}, range(3, 5), [0, 1, 2, 3, 3, 5]),
        ({"kind": "stuck", "value": 7.0}, range(3, 5), [0, 1, 2, 7, 7, 5]),
    ],
)
def test_a_distortion_changes_a_ramp_while_it_acts(
    fields: dict[str, Any], ticks: range, expected: list[float]
) -> None:
    assert distorted(fields, ticks, RAMP) == pytest.approx(expected)


def test_noise_has_its_deviation_and_is_repeatable() -> None:
    ticks, still = range(1, 2000), [0.0] * 2000
    values = distorted({"kind": "noise", "value": 0.2, "seed": 3}, ticks, still)
    assert (sum(v * v for v in values) / 2000) ** 0.5 == pytest.approx(0.2, rel=0.05)
    assert values == distorted({"kind": "noise", "value": 0.2, "seed": 3}, ticks, still)
    assert values != distorted({"kind": "noise", "value": 0.2, "seed": 4}, ticks, still)
