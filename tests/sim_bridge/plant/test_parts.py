"""The parts of the car alone, against the published points of their parameters."""

from itertools import pairwise
from math import degrees, hypot, pi, radians, tan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rt_controller.contract.errors import ConfigError
from sim_bridge.plant import body, brakes, steering
from sim_bridge.plant.drive import engine, gearbox, powertrain
from sim_bridge.plant.parameters import default_car, with_road_friction
from sim_bridge.plant.tyre import tyres

CAR = default_car()
FRONT_LOAD_N, REAR_LOAD_N = 4705.0, 2655.0


def lateral_n(angle_deg: float, load_n: float, road: float = 1.0) -> float:
    return tyres.force(tan(radians(angle_deg)), 0.0, 0.0, load_n, road, CAR.tyre).left_n


def test_tyre_friction_has_the_published_peaks() -> None:
    """On a road of 0.85: 0.82 at 2.6 kN and 0.81 at 6.5 kN; falling by a tenth at 25 deg."""
    angles = np.arange(0.5, 30.0, 0.05)
    for load_n, peak in ((2600.0, 0.82), (6500.0, 0.81)):
        friction = np.array([lateral_n(a, load_n, 0.85) / load_n for a in angles])
        assert friction.max() == pytest.approx(peak, abs=0.01)
    load_n = CAR.tyre.reference_load_n
    friction = np.array([lateral_n(a, load_n) / load_n for a in angles])
    assert angles[friction.argmax()] == pytest.approx(8.5, abs=0.5)
    assert np.interp(25.0, angles, friction) == pytest.approx(0.96 * 0.88 / 0.974, abs=0.01)

    slips = np.arange(0.01, 0.4, 0.001)
    along = [tyres.force(0.0, s, 0.0, load_n, 1.0, CAR.tyre).forward_n / load_n for s in slips]
    assert max(along) == pytest.approx(0.974, abs=1e-3)
    assert slips[int(np.argmax(along))] == pytest.approx(0.14, abs=0.005)


@pytest.mark.parametrize(("load_n", "axle_npr"), [(FRONT_LOAD_N, 153e3), (REAR_LOAD_N, 96e3)])
def test_axles_have_the_stated_cornering_stiffness(load_n: float, axle_npr: float) -> None:
    secant = 2.0 * lateral_n(0.8, load_n) / radians(0.8)
    assert secant == pytest.approx(axle_npr, rel=0.03)


def test_friction_decreases_with_load_and_stiffness_is_degressive() -> None:
    loads = np.linspace(1000.0, 9000.0, 9)
    across = np.array([tyres.lateral_limit_n(n, CAR.tyre) / n for n in loads])
    along = np.array([tyres.longitudinal_limit_n(n, CAR.tyre) / n for n in loads])
    stiffness = np.array([tyres.cornering_stiffness_npr(n, CAR.tyre) for n in loads])
    assert np.all(np.diff(across) < 0.0)
    assert np.all(np.diff(along) < 0.0)
    assert np.all(np.diff(stiffness) > 0.0)
    assert np.all(np.diff(stiffness, 2) < 0.0)


@pytest.mark.parametrize("road", [0.3, 0.5, 0.85])
def test_a_slippery_road_scales_the_curve_by_similarity(road: float) -> None:
    """F = mu f(slip / mu): the stiffness is constant, peak and its slip decrease together."""
    for slip in (0.001, 0.02, 0.1, 0.3):
        here = tyres.force(slip, -0.5 * slip, 0.0, 4000.0, road, CAR.tyre)
        there = tyres.force(slip / road, -0.5 * slip / road, 0.0, 4000.0, 1.0, CAR.tyre)
        assert here.left_n == pytest.approx(road * there.left_n)
        assert here.forward_n == pytest.approx(road * there.forward_n)


@settings(max_examples=500, deadline=None, derandomize=True)
@given(
    across=st.floats(-3.0, 3.0),
    along=st.floats(-3.0, 3.0),
    lean=st.floats(-0.3, 0.3),
    load_n=st.floats(1.0, 15000.0),
    road=st.floats(0.05, 1.5),
)
def test_combined_force_stays_within_friction(
    across: float, along: float, lean: float, load_n: float, road: float
) -> None:
    force = tyres.force(across, along, lean, load_n, road, CAR.tyre)
    share = hypot(
        force.forward_n / tyres.longitudinal_limit_n(load_n, CAR.tyre),
        force.left_n / tyres.lateral_limit_n(load_n, CAR.tyre),
    )
    assert share <= road * (1.0 + 1e-9)


def test_each_slip_reduces_the_force_in_the_other_direction() -> None:
    for slip in (0.02, 0.05, 0.1, 0.3):
        pure = tyres.force(0.05, 0.0, 0.0, 4000.0, 1.0, CAR.tyre).left_n
        mixed = tyres.force(0.05, slip, 0.0, 4000.0, 1.0, CAR.tyre).left_n
        assert 0.0 < mixed < pure
        pure = tyres.force(0.0, 0.05, 0.0, 4000.0, 1.0, CAR.tyre).forward_n
        mixed = tyres.force(slip, 0.05, 0.0, 4000.0, 1.0, CAR.tyre).forward_n
        assert 0.0 < mixed < pure


@pytest.mark.parametrize("angle_deg", [5.0, 20.0, 45.0, 70.0])
def test_the_force_of_a_locked_wheel_is_opposite_to_its_sliding(angle_deg: float) -> None:
    """A locked wheel has slip -1 and the tangent of the angle."""
    force = tyres.force(-tan(radians(angle_deg)), -1.0, 0.0, 4500.0, 1.0, CAR.tyre)
    against = degrees(np.arctan2(-force.left_n, -force.forward_n))
    assert against == pytest.approx(angle_deg, abs=2.0)


def test_the_aligning_moment_ends_before_the_side_force() -> None:
    """A trail of 31 mm at small slip, zero at 6 deg, nearly zero where the tyre slides."""

    def trail_m(angle_deg: float) -> float:
        force = tyres.force(tan(radians(angle_deg)), 0.0, 0.0, 4500.0, 1.0, CAR.tyre)
        return -force.aligning_nm / force.left_n

    assert trail_m(0.01) == pytest.approx(0.031, rel=0.01)
    assert trail_m(6.0) == pytest.approx(0.0, abs=1e-3)
    assert -0.01 < trail_m(15.0) < 0.0


def test_a_tyre_without_load_has_no_force() -> None:
    assert tyres.force(0.1, 0.1, 0.1, 0.0, 1.0, CAR.tyre) == (0.0, 0.0, 0.0)


def test_camber_thrust_acts_to_the_side_of_the_lean() -> None:
    """0.008 of the load per degree."""
    force = tyres.force(0.0, 0.0, radians(1.0), 4000.0, 1.0, CAR.tyre)
    assert force.left_n == pytest.approx(-0.008 * 4000.0, rel=0.05)


def test_the_lagged_slip_converges_to_the_steady_slip() -> None:
    forward_mps, left_mps = 20.0, -0.3
    lag = tyres.lateral_relaxation(0.0, forward_mps, left_mps, 4000.0, CAR.tyre)
    assert lag.rate / lag.decay == pytest.approx(-left_mps / forward_mps)
    assert forward_mps / lag.decay == pytest.approx(0.65 * 4000.0 / 6500.0)
    along = tyres.longitudinal_relaxation(0.0, forward_mps, 19.0, 4000.0, CAR.tyre)
    assert along.rate / along.decay == pytest.approx(-0.05)


def full_throttle_nm(speed_rpm: float) -> float:
    return engine.torque_nm(speed_rpm / engine.RPM_OF_RADPS, 1.0, 1.0, CAR.engine)


def test_the_engine_has_its_published_torque_and_power() -> None:
    speeds = np.arange(800.0, 6200.0, 1.0)
    torque = np.array(
        [engine.torque_nm(n / engine.RPM_OF_RADPS, 1.0, 1.0, CAR.engine) for n in speeds]
    )
    power_kw = torque * speeds / engine.RPM_OF_RADPS / 1000.0
    assert torque.max() == pytest.approx(309.9, abs=0.2)
    assert speeds[torque.argmax()] == pytest.approx(3603.0, abs=2.0)
    assert power_kw.max() == pytest.approx(151.0, abs=0.3)
    assert speeds[power_kw.argmax()] == pytest.approx(5030.0, abs=30.0)


def test_the_closed_throttle_brakes_and_the_governor_keeps_idle_speed() -> None:
    def closed_nm(speed_rpm: float) -> float:
        return engine.torque_nm(speed_rpm / engine.RPM_OF_RADPS, 0.0, 1.0, CAR.engine)

    assert closed_nm(750.0) == pytest.approx(0.0, abs=1e-9)
    assert closed_nm(500.0) > 50.0
    assert closed_nm(6000.0) == pytest.approx(-80.0, abs=1.0)
    assert full_throttle_nm(6500.0) < 0.0


def test_torque_increases_with_throttle() -> None:
    for speed in (80.0, 200.0, 400.0, 600.0):
        torques = [engine.torque_nm(speed, th, 1.0, CAR.engine) for th in np.linspace(0.0, 1.0, 21)]
        assert np.all(np.diff(torques) >= 0.0)
        assert torques[-1] > torques[4] > torques[0]


def test_the_converter_has_its_published_stall_and_coupling_points() -> None:
    stall = powertrain.converter_torque(200.0, 0.0, CAR.converter)
    assert stall.turbine_nm / stall.impeller_nm == pytest.approx(1.864)
    assert stall.impeller_nm == pytest.approx((0.00704 * 200.0 * 30.0 / pi) ** 2)
    coupled = powertrain.converter_torque(200.0, 0.881 * 200.0, CAR.converter)
    assert coupled.turbine_nm == pytest.approx(coupled.impeller_nm)


def test_the_converter_has_no_power_gain() -> None:
    for turbine in np.linspace(0.0, 700.0, 71):
        torque = powertrain.converter_torque(300.0, turbine, CAR.converter)
        assert torque.turbine_nm * turbine <= torque.impeller_nm * 300.0 + 1e-9


def test_the_converter_torque_is_smooth_at_equal_speeds() -> None:
    below, at, above = (
        powertrain.converter_torque(300.0, 300.0 + d, CAR.converter).turbine_nm
        for d in (-1e-3, 0.0, 1e-3)
    )
    assert at == 0.0
    assert below == pytest.approx(-above, rel=1e-4)


def test_no_up_shift_is_followed_by_a_down_shift() -> None:
    ratios = CAR.gearbox.ratios
    for throttle in np.linspace(0.0, 1.0, 41):
        up = gearbox.up_shift_rpm(throttle, CAR.gearbox)
        down = gearbox.down_shift_rpm(throttle, CAR.gearbox)
        for low, high in pairwise(ratios):
            assert up * high / low > 1.05 * down


def test_the_ratio_changes_monotonically_during_a_shift() -> None:
    times = np.linspace(0.0, CAR.gearbox.shift_time_s, 26)
    ratios = [gearbox.ratio(3.0, 2.0, t, CAR.gearbox) for t in times]
    assert ratios[0] == pytest.approx(2.06)
    assert ratios[-1] == pytest.approx(1.404)
    assert np.all(np.diff(ratios) <= 0.0)


def test_an_up_shift_reduces_the_torque_temporarily() -> None:
    span_s = CAR.gearbox.shift_time_s
    kept = [gearbox.kept_torque(3.0, 2.0, t, CAR.gearbox) for t in np.linspace(0.0, span_s, 26)]
    assert kept[0] == 1.0
    assert kept[-1] == 1.0
    assert min(kept) < 0.05
    down = [gearbox.kept_torque(2.0, 3.0, t, CAR.gearbox) for t in np.linspace(0.0, span_s, 26)]
    assert down == [1.0] * 26


def test_the_centre_differential_splits_evenly_and_drives_the_slower_axle() -> None:
    even = powertrain.axle_torque(100.0, 50.0, 50.0, CAR.driveline)
    assert even.front_wheel_nm == pytest.approx(even.rear_wheel_nm)
    assert 2.0 * (even.front_wheel_nm + even.rear_wheel_nm) == pytest.approx(100.0 * 0.93)
    spinning = powertrain.axle_torque(100.0, 60.0, 50.0, CAR.driveline)
    assert spinning.front_wheel_nm < even.front_wheel_nm
    assert spinning.rear_wheel_nm - even.rear_wheel_nm == pytest.approx(
        even.front_wheel_nm - spinning.front_wheel_nm
    )


def test_the_axle_drives_lose_power_in_both_directions() -> None:
    pulled = powertrain.axle_torque(100.0, 50.0, 50.0, CAR.driveline)
    dragged = powertrain.axle_torque(-100.0, 50.0, 50.0, CAR.driveline)
    assert 2.0 * (pulled.front_wheel_nm + pulled.rear_wheel_nm) < 100.0
    assert 2.0 * (dragged.front_wheel_nm + dragged.rear_wheel_nm) < -100.0


def test_the_rear_brake_pressure_is_reduced_above_its_knee() -> None:
    assert brakes.steady_pressures_mpa(37.5, CAR.brakes) == pytest.approx((1.5, 1.5))
    assert brakes.steady_pressures_mpa(150.0, CAR.brakes) == pytest.approx((6.0, 1.5 + 0.3 * 4.5))
    assert brakes.steady_pressures_mpa(-1.0, CAR.brakes) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("speed", "change", "left"),
    [(3.0, 1.0, 2.0), (-3.0, 1.0, -2.0), (0.5, 1.0, 0.0), (0.0, 9.0, 0.0)],
)
def test_dry_friction_stops_a_motion_and_never_reverses_it(
    speed: float, change: float, left: float
) -> None:
    assert brakes.after_friction(speed, change) == left


def steady_road_wheel_rad(steer_rad: float, front_n: float) -> float:
    """Steady road-wheel angle under a small side force of the front axle."""
    tyres_nm = steering.kingpin_nm(-CAR.tyre.trail_m * front_n, front_n, CAR.steering)
    free = steering.steering_radps2(steer_rad, 0.0, 0.0, tyres_nm, CAR.steering)
    per_rad = CAR.steering.stiffness_nmprad / CAR.steering.inertia_kgm2
    return free / per_rad


def test_the_column_has_a_quarter_of_the_published_compliance() -> None:
    """The rest of 3.2e-5 deg per N is the give of the bushings."""
    free = steady_road_wheel_rad(radians(37.0), 0.0)
    loaded = steady_road_wheel_rad(radians(37.0), 1000.0)
    assert degrees(free) == pytest.approx(2.0)
    assert degrees(free - loaded) == pytest.approx(0.032 / 4.0, rel=0.15)


def test_the_steering_returns_to_the_centre_and_is_damped() -> None:
    away = steering.steering_radps2(0.0, 0.1, 0.0, 0.0, CAR.steering)
    moving = steering.steering_radps2(0.0, 0.0, 1.0, 0.0, CAR.steering)
    assert away < 0.0
    assert moving < 0.0


def test_drag_is_opposite_to_the_motion() -> None:
    ahead, back = (body.air_force(v, 0.0, CAR.road, CAR.aero) for v in (30.0, -30.0))
    assert ahead.forward_n == pytest.approx(-0.5 * 1.206 * 2.2 * 0.30 * 900.0)
    assert back.forward_n == -ahead.forward_n
    assert ahead.up_n > 0.0
    assert ahead.left_n == 0.0


def test_air_from_the_right_pushes_to_the_left_and_turns_the_nose_left() -> None:
    windy = CAR.road._replace(wind_left_mps=10.0)
    air = body.air_force(30.0, 0.0, windy, CAR.aero)
    assert air.left_n > 0.0
    assert air.yaw_nm > 0.0
    slipping = body.air_force(30.0, -10.0, CAR.road, CAR.aero)
    assert slipping.left_n == pytest.approx(air.left_n)


@pytest.mark.parametrize("friction", [0.0, -0.5, float("nan"), float("inf")])
def test_a_road_friction_that_is_not_positive_is_refused(friction: float) -> None:
    with pytest.raises(ConfigError, match="road friction: expected a positive number"):
        with_road_friction(CAR, friction)
