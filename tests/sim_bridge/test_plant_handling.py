"""How the car steers: a slowly increasing steer at 80 km/h against the car it stands for."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_bridge.plant.integrate import STEP_S, STEPS_PER_PERIOD, advance, glance, settle
from sim_bridge.plant.monitor import N_MONITOR, Monitor
from sim_bridge.plant.parameters import C_CLASS_150KW_AWD as CAR
from sim_bridge.plant.parameters import GRAVITY_MPS2
from sim_bridge.plant.states import AT

SPEED_MPS = 80.0 / 3.6
WHEELBASE_M = 2.910


@dataclass(frozen=True, slots=True)
class Ramp:
    """A run with slowly increasing steer, one row a period."""

    steer_rad: NDArray[np.float64]
    motion: NDArray[np.float64]
    monitor: NDArray[np.float64]

    def column(self, name: str) -> NDArray[np.float64]:
        return self.monitor[:, Monitor._fields.index(name)]

    @property
    def lateral_g(self) -> NDArray[np.float64]:
        return self.column("ay_mps2") / GRAVITY_MPS2

    @property
    def is_linear(self) -> NDArray[np.bool_]:
        return (self.lateral_g > 0.02) & (self.lateral_g < 0.3)


@pytest.fixture(scope="module")
def ramp() -> Ramp:
    """2 deg/s at the wheel up to 40 deg; the throttle holds the speed."""
    state = settle(SPEED_MPS, CAR)
    held = float(state[AT.throttle])
    piece = np.empty((STEPS_PER_PERIOD, 3))
    steer_rad = np.radians(2.0 * 0.025 * np.arange(800))
    motion = np.empty((800, 3))
    monitor = np.empty((800, N_MONITOR))
    for k in range(800):
        slower = SPEED_MPS - state[AT.vx_mps]
        held += 0.3 * slower * 0.025
        throttle = min(1.0, max(0.0, held + 0.5 * slower))
        advance(state, throttle, 0.0, steer_rad[k], CAR, STEPS_PER_PERIOD, STEP_S, piece)
        glance(state, throttle, 0.0, steer_rad[k], CAR, monitor[k])
        motion[k] = piece[-1]
    return Ramp(steer_rad, motion, monitor)


def degrees_per_g(ramp: Ramp, angle_rad: NDArray[np.float64]) -> float:
    """Growth of an angle per g of lateral acceleration, up to 0.3 g."""
    linear = ramp.is_linear
    return float(np.polyfit(ramp.lateral_g[linear], np.degrees(angle_rad[linear]), 1)[0])


def test_the_ramp_is_driven_at_constant_speed(ramp: Ramp) -> None:
    np.testing.assert_allclose(ramp.motion[:, 0], SPEED_MPS, atol=0.1)


def test_wheel_angle_at_three_tenths_g(ramp: Ramp) -> None:
    angle = np.interp(0.3, ramp.lateral_g, np.degrees(ramp.steer_rad))
    assert angle == pytest.approx(26.95, rel=0.05)


def test_steering_effort_and_understeer(ramp: Ramp) -> None:
    """Understeer at the steering wheel, over the ratio, has the compliance in it."""
    bend_deg_per_g = np.degrees(WHEELBASE_M * GRAVITY_MPS2 / SPEED_MPS**2)
    effort = degrees_per_g(ramp, ramp.steer_rad)
    assert effort == pytest.approx(88.0, rel=0.05)
    assert effort / CAR.steering.ratio - bend_deg_per_g == pytest.approx(1.43, rel=0.05)
    at_the_road = degrees_per_g(ramp, ramp.column("road_wheel_rad"))
    assert at_the_road - bend_deg_per_g == pytest.approx(1.15, rel=0.05)


def test_yaw_gain(ramp: Ramp) -> None:
    linear = ramp.is_linear
    gain = np.polyfit(ramp.steer_rad[linear], ramp.motion[linear, 2], 1)[0]
    assert gain == pytest.approx(0.289, rel=0.05)


def test_roll_and_sideslip(ramp: Ramp) -> None:
    assert degrees_per_g(ramp, ramp.column("roll_rad")) == pytest.approx(4.45, rel=0.1)
    assert degrees_per_g(ramp, ramp.column("sideslip_rad")) == pytest.approx(-0.59, rel=0.1)


def test_the_front_axle_gives_way_first() -> None:
    """At 100 km/h and far beyond the limit the car ploughs on and does not spin."""
    state = settle(100.0 / 3.6, CAR)
    motion = np.empty((STEPS_PER_PERIOD, 3))
    row = np.empty(N_MONITOR)
    lateral_g = []
    for k in range(480):
        throttle = float(np.clip(0.3 + 0.5 * (100.0 / 3.6 - state[AT.vx_mps]), 0.0, 1.0))
        steer_rad = np.radians(10.0 * 0.025 * k)
        advance(state, throttle, 0.0, steer_rad, CAR, STEPS_PER_PERIOD, STEP_S, motion)
        glance(state, throttle, 0.0, steer_rad, CAR, row)
        lateral_g.append(row[Monitor._fields.index("ay_mps2")] / GRAVITY_MPS2)
    front = abs(state[AT.lateral_slip])
    rear = abs(state[AT.lateral_slip + 2])
    assert 0.7 < max(lateral_g) < 0.85
    assert front > 1.5 * rear
    assert abs(np.degrees(row[Monitor._fields.index("sideslip_rad")])) < 5.0
