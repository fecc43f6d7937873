"""The values that a fault of signals leaves."""

import pytest

from sim_bridge.faults.distortion import Distortion
from sim_bridge.scenario.faults import Fault, FaultKind


def distorted(fault: Fault, values: list[float]) -> list[float]:
    """The first of two values, tick by tick."""
    distortion = Distortion(fault, [0], 0)
    found = []
    for tick, value in enumerate(values):
        vector = [value, value]
        distortion.apply(vector, (value, value), tick)
        assert vector[1] == value, "the other value is not changed"
        found.append(vector[0])
    return found


RAMP = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (Fault(FaultKind.FREEZE, range(2, 5)), [0, 1, 2, 2, 2, 5]),
        (Fault(FaultKind.LAG, range(2, 5), delay_ticks=2), [0, 1, 0, 1, 2, 5]),
        (Fault(FaultKind.LAG, range(1, 3), delay_ticks=9), [0, 0, 0, 3, 4, 5]),
        (Fault(FaultKind.SCALE, range(2, 4), value=-1.0), [0, 1, -2, -3, 4, 5]),
        (Fault(FaultKind.BIAS, range(2, 4), value=0.5), [0, 1, 2.5, 3.5, 4, 5]),
        (Fault(FaultKind.DRIFT, range(2, 5), value=4.0), [0, 1, 2.1, 3.2, 4.3, 5]),
        (Fault(FaultKind.QUANTISE, range(1, 6), value=2.0), [0, 0, 2, 4, 4, 4]),
        (Fault(FaultKind.SET, range(4, 9), value=9.0), [0, 1, 2, 3, 9, 9]),
        (Fault(FaultKind.RATE, range(2, 5), value=20.0), [0, 1, 1.5, 2, 2.5, 5]),
        (Fault(FaultKind.RATE, range(6), value=20.0), [0, 0.5, 1, 1.5, 2, 2.5]),
        (Fault(FaultKind.RATE, range(2, 5), value=80.0), [0, 1, 2, 3, 4, 5]),
        (Fault(FaultKind.STUCK, range(3, 5)), [0, 1, 2, 3, 3, 5]),
        (Fault(FaultKind.STUCK, range(3, 5), value=7.0), [0, 1, 2, 7, 7, 5]),
    ],
)
def test_a_distortion_changes_a_ramp_while_it_acts(fault: Fault, expected: list[float]) -> None:
    assert distorted(fault, RAMP) == pytest.approx(expected)


def test_noise_has_its_deviation_and_is_repeatable() -> None:
    fault = Fault(FaultKind.NOISE, range(2000), value=0.2, seed=3)
    values = distorted(fault, [0.0] * 2000)
    assert (sum(v * v for v in values) / 2000) ** 0.5 == pytest.approx(0.2, rel=0.05)
    assert values == distorted(fault, [0.0] * 2000)
    assert values != distorted(fault._replace(seed=4), [0.0] * 2000)
