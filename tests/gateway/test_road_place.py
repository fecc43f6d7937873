"""Place of a car that measures its own place on the road."""

from typing import cast

import pytest

from rt_controller.contract.timing import PERIOD_S
from rt_controller.gateway.road_place import PlaceMeasured
from rt_controller.gateway.samples import Motion, MotionHistory, Sample, Samples

MOTION = Motion(time_ns=0, vx_mps=20.0, vy_mps=0.0, yaw_rate_radps=0.0)


class MeasuredPlace:
    """Samples of e_y, e_psi and the curvature."""

    def __init__(self, ey_m: float, epsi_rad: float, curvature_per_m: float) -> None:
        self.values = {
            "states.ey_m": ey_m,
            "states.epsi_rad": epsi_rad,
            "exogenous.curvature_per_m": curvature_per_m,
        }

    def newest(self, name: str, now_ns: int) -> Sample:
        return Sample(self.values[name], now_ns)


@pytest.mark.parametrize(
    ("ey_m", "curvature_per_m", "expected_m"),
    [
        (0.0, 0.0, 20.0 * PERIOD_S),
        (10.0, 0.02, 20.0 * PERIOD_S / 0.8),
        (10.0, 0.1, 20.0 * PERIOD_S / 0.05),  # at the centre of the bend: limited
    ],
)
def test_progress_is_finite_everywhere(
    ey_m: float, curvature_per_m: float, expected_m: float
) -> None:
    samples = cast("Samples", MeasuredPlace(ey_m, 0.0, curvature_per_m))
    place = PlaceMeasured().locate(samples, MotionHistory(), MOTION)
    assert place is not None
    assert place.ds_m == pytest.approx(expected_m)
