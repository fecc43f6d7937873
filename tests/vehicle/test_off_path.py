"""A car that leaves its path by the vehicle's own measurement, and how far off it will be."""

import pytest

from rt_controller.bus.messages import Command
from rt_controller.contract.signals import (
    NEUTRAL_INPUT,
    ControlInput,
    Mode,
    PathReference,
    VehicleState,
)
from rt_controller.vehicle.vehicle_envelope import (
    FARTHEST_OFF_PATH_M,
    OwnMotion,
    leaves_path,
    off_path_m,
)
from sim_bridge.scenario import load_scenario
from sim_bridge.scenario_run import ScenarioRun

CRUISE = ControlInput(0.2, 0.0, 0.1)
MOVING = OwnMotion(20.0, 0.0, is_mission_on=True)


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize(
    ("off_m", "speed_mps"), [(0.6, 20.0), (-0.6, 20.0), (0.4, 20.0), (0.8, 20.0), (2.0, 0.5)]
)
def test_up_to_90_cm_only_a_moving_safe_stop_leaves_the_path(
    mode: Mode, off_m: float, speed_mps: float
) -> None:
    motion = OwnMotion(speed_mps, off_m, is_mission_on=True)
    is_leaving = mode is Mode.SAFE_STOP and abs(off_m) > FARTHEST_OFF_PATH_M and speed_mps > 1.0
    assert leaves_path(Command(CRUISE, mode), motion, True) is is_leaving


@pytest.mark.parametrize("mode", Mode)
@pytest.mark.parametrize(
    ("off_m", "is_far"), [(0.9, False), (-0.9, False), (0.91, True), (-0.91, True)]
)
@pytest.mark.parametrize("is_mission_on", [True, False])
@pytest.mark.parametrize("has_reached_path", [True, False])
def test_a_controller_that_drives_leaves_the_path_at_90_cm(
    mode: Mode, off_m: float, is_far: bool, is_mission_on: bool, has_reached_path: bool
) -> None:
    motion = OwnMotion(20.0, off_m, is_mission_on)
    is_driven = mode not in (Mode.STANDBY, Mode.SAFE_STOP) and is_mission_on and has_reached_path
    is_leaving = mode is Mode.SAFE_STOP or (is_driven and is_far)
    assert leaves_path(Command(CRUISE, mode), motion, has_reached_path) is is_leaving


@pytest.mark.parametrize(
    ("off_m", "is_left"), [(0.49, False), (0.5, False), (0.51, True), (-0.5, False), (-0.51, True)]
)
def test_half_a_metre_off_the_path_is_left(off_m: float, is_left: bool) -> None:
    motion = MOVING._replace(off_path_m=off_m)
    assert leaves_path(Command(NEUTRAL_INPUT, Mode.SAFE_STOP), motion, True) is is_left


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_car_is_as_far_off_its_path_as_it_will_be_in_0_3_s(side: float) -> None:
    state = VehicleState(20.0, 0.0, 0.0, 0.5, side * 0.1, side * 0.05)
    run = ScenarioRun(load_scenario("straight"), state, 0.0)
    assert run.motion == pytest.approx((20.0, side * (0.1 + 20.0 * 0.05 * 0.3), True))
    turning_m = 0.1 + 0.3 * (20.0 * 0.05 + 0.5) + 0.5 * 0.3**2 * 20.0 * 0.2
    # One that turns back may overshoot: its heading counts.
    for vy_mps, yaw_rate_radps, off_m in ((0.5, 0.2, turning_m), (0.0, -0.4, 0.4)):
        moving = state._replace(vy_mps=side * vy_mps, yaw_rate_radps=side * yaw_rate_radps)
        run = ScenarioRun(load_scenario("straight"), moving, 0.0)
        assert run.motion.off_path_m == pytest.approx(side * off_m)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("yaw_rate_radps", "expected_m"),
    [(0.05, 0.66499), (-0.1, 0.60199)],  # by the motion, and by the heading
)
def test_the_deviation_ahead_is_the_larger_one_of_heading_and_motion(
    side: float, yaw_rate_radps: float, expected_m: float
) -> None:
    """0.3 m beside the path, which is met at 20 m/s with 0.15 rad - atan(0.1)."""
    path = PathReference(0.2 * side, 0.1 * side, 0.001 * side, 0.0, 20.0, 0.0)
    state = VehicleState(20.0, 0.3 * side, yaw_rate_radps * side, 0.5, 0.5 * side, 0.15 * side)
    found_m = off_path_m(path, state, 0.002 * side)
    assert found_m == pytest.approx(expected_m * side, abs=1e-4)
