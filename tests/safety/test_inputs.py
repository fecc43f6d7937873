"""Faulty signals of the motion are replaced by expected ones."""

import pytest

from rt_controller.contract.signals import VehicleState
from rt_controller.safety.isolation import Faulty
from rt_controller.safety.motion import with_replaced_signals

MEASURED = VehicleState(20.0, 0.1, 0.2, 0.4, 0.5, 0.01)
EXPECTED = VehicleState(18.0, 0.0, 0.1, 0.45, 0.6, 0.02)


@pytest.mark.parametrize(
    ("faulty", "expected"),
    [
        (Faulty.NONE, MEASURED),
        (Faulty.PLACE, MEASURED),
        (Faulty.SPEED, MEASURED._replace(vx_mps=0.4 / 0.025)),
        (Faulty.PROGRESS, MEASURED._replace(ds_m=20.0 * 0.025)),
        (
            Faulty.SPEED | Faulty.PROGRESS,
            MEASURED._replace(vx_mps=18.0, ds_m=18.0 * 0.025),
        ),
        (Faulty.LATERAL_SPEED, MEASURED._replace(vy_mps=0.0)),
        (Faulty.YAW_RATE, MEASURED._replace(yaw_rate_radps=0.1)),
    ],
)
def test_a_faulty_signal_of_the_motion_is_replaced(faulty: int, expected: VehicleState) -> None:
    assert with_replaced_signals(MEASURED, EXPECTED, faulty) == pytest.approx(expected)
