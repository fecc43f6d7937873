"""The low-speed law on a rolling car: it stops, holds, starts and steers for a class of cars."""

from collections.abc import Callable
from itertools import pairwise
from math import inf, isfinite, sqrt
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rolling_car import ASSUMED, RollingCar

from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode, PathReference
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.low_speed import ROLLING_MPS, LowSpeedLaw
from rt_controller.safety.envelope import limit

Planner = Callable[[RollingCar, float], PathReference]
STRAIGHT = PathReference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Tick(NamedTuple):
    time_s: float
    s_m: float
    ey_m: float
    vx_mps: float
    law: Mode
    control: ControlInput


def drive(
    car: RollingCar,
    planner: Planner,
    duration_s: float,
    noise: np.random.Generator | None = None,
    vx_sigma_mps: float = 0.01,
    vx_offset_mps: float = 0.0,
) -> list[Tick]:
    """The law, above its speeds a driver who knows the car; commands pass the envelope."""
    law, control, state = LowSpeedLaw(ASSUMED), NEUTRAL_INPUT, car.state()
    ticks: list[Tick] = []
    for k in range(round(duration_s / PERIOD_S)):
        seen = state
        if noise is not None:
            seen = state._replace(
                vx_mps=state.vx_mps + vx_offset_mps + noise.normal(0.0, vx_sigma_mps),
                ey_m=state.ey_m + noise.normal(0.0, 0.005),
                epsi_rad=state.epsi_rad + noise.normal(0.0, 0.001),
            )
        path = planner(car, k * PERIOD_S)
        law.observe(seen, control)
        chosen = law.choose(seen.vx_mps, path)
        if chosen is Mode.NOMINAL:
            wanted_mps2 = path.a_mps2 + 2.0 * (path.v_mps - car.vx_mps) - car.resistance_mps2()
            wanted = ControlInput(
                max(wanted_mps2, 0.0) / car.throttle_mps2,
                max(-wanted_mps2, 0.0) / car.brake_mps2_per_n,
                control.steer_rad,
            )
        else:
            wanted = law.control(seen, car.curvature_per_m, path, control)
            assert all(map(isfinite, wanted))
            assert all(np.array(INPUT_LIMITS.lower) <= wanted)
            assert all(wanted <= np.array(INPUT_LIMITS.upper))
            assert wanted.throttle == 0.0 or wanted.brake_n == 0.0
        control = limit(wanted, control)
        ticks.append(Tick(k * PERIOD_S, car.s_m, car.ey_m, car.vx_mps, chosen, control))
        state = car.step(control)
    return ticks


class StopThenGo:
    """Plans a stop at `at_m` with `braking_mps2`, a hold, and a start; the car moves before it."""

    def __init__(self, at_m: float, braking_mps2: float, cruise_mps: float, hold_s: float) -> None:
        self.at_m, self.braking_mps2, self.cruise_mps = at_m, braking_mps2, cruise_mps
        self.hold_s = hold_s
        self._stood_s = inf

    def __call__(self, car: RollingCar, time_s: float) -> PathReference:
        started_s = self._stood_s + self.hold_s
        if time_s >= started_s:
            return STRAIGHT._replace(
                v_mps=min(1.5 * (time_s - started_s), self.cruise_mps), a_mps2=1.5
            )
        if car.s_m > self.at_m - 0.3 and abs(car.vx_mps) < 0.1:
            self._stood_s = min(self._stood_s, time_s)
        if self._stood_s < inf:
            return STRAIGHT
        v_mps = sqrt(2.0 * self.braking_mps2 * max(self.at_m - car.s_m, 0.0))
        if v_mps > self.cruise_mps:
            return STRAIGHT._replace(v_mps=self.cruise_mps)
        return STRAIGHT._replace(v_mps=v_mps, a_mps2=-self.braking_mps2)


def changes(ticks: list[Tick]) -> int:
    return sum(a.law is not b.law for a, b in pairwise(ticks))


cars = st.builds(
    RollingCar,
    vx_mps=st.floats(4.5, 8.0),
    throttle_mps2=st.floats(2.0, 12.0),
    brake_mps2_per_n=st.floats(0.035, 0.08),
    lag_s=st.floats(0.03, 0.25),
    creep_mps2=st.floats(0.0, 1.5),
    slope_mps2=st.floats(-0.8, 0.8),
)


@settings(max_examples=40, deadline=None)
@given(cars, st.floats(0.8, 3.0), st.integers(0, 2**31))
def test_a_car_that_is_not_known_well_stops_at_its_target_holds_and_starts(
    car: RollingCar, braking_mps2: float, seed: int
) -> None:
    target_m = 5.0 + car.vx_mps**2 / 2.0 / braking_mps2
    planner = StopThenGo(target_m, braking_mps2, car.vx_mps, hold_s=3.0)
    ticks = drive(car, planner, 25.0, np.random.default_rng(seed))
    held = [tick for tick in ticks if tick.law is Mode.STANDSTILL]
    is_late = car.lag_s > 0.15 and braking_mps2 > 2.0  # decision 019
    assert abs(held[0].s_m - target_m) < (0.5 if is_late else 0.25)
    assert np.ptp([tick.s_m for tick in held]) < 0.02
    assert np.ptp([tick.control.steer_rad for tick in held]) == 0.0
    assert changes(ticks) == 4  # model, low speed, standstill, low speed, model
    assert ticks[-1].law is Mode.NOMINAL


@settings(max_examples=15, deadline=None)
@given(cars, st.floats(0.0, 6.0), st.integers(0, 2**31))
def test_a_constant_reference_speed_is_held_without_chatter(
    car: RollingCar, reference_mps: float, seed: int
) -> None:
    path = STRAIGHT._replace(v_mps=reference_mps)
    ticks = drive(car, lambda car, time_s: path, 20.0, np.random.default_rng(seed))
    assert changes(ticks) <= 3
    late = ticks[len(ticks) // 2 :]
    assert changes(late) == 0
    pressed = [tick.control.throttle > 0.0 for tick in late if max(tick.control[:2]) > 0.0]
    assert sum(a != b for a, b in pairwise(pressed)) <= 2
    assert late[-1].vx_mps == pytest.approx(reference_mps, abs=0.4)


def test_a_reference_of_zero_stops_the_car_at_once_and_holds_it() -> None:
    ticks = drive(RollingCar(3.9), lambda car, time_s: STRAIGHT, 10.0)
    stood = next(tick for tick in ticks if tick.law is Mode.STANDSTILL)
    assert stood.time_s < 2.5
    assert ticks[-1].control.brake_n == pytest.approx(75.0, abs=1.0)
    assert ticks[-1].s_m - stood.s_m < 0.01


@pytest.mark.parametrize(("slope_mps2", "most_m"), [(-2.0, 0.2), (-1.0, 0.05), (1.5, 0.0)])
def test_a_start_on_an_unknown_slope_rolls_back_little(slope_mps2: float, most_m: float) -> None:
    def planner(car: RollingCar, time_s: float) -> PathReference:
        if time_s < 2.0:
            return STRAIGHT
        return STRAIGHT._replace(v_mps=1.0 * (time_s - 2.0), a_mps2=1.0)

    car = RollingCar(0.0, creep_mps2=0.0, slope_mps2=slope_mps2)
    ticks = drive(car, planner, 8.0)
    assert ticks[-1].vx_mps > 3.0
    held = [tick for tick in ticks if tick.law is Mode.STANDSTILL]
    started = ticks[ticks.index(held[-1]) :]
    assert min(tick.s_m for tick in started) >= held[-1].s_m - most_m


@pytest.mark.parametrize("slope_mps2", [-0.8, 0.0, 0.8])
@pytest.mark.parametrize("acceleration_mps2", [0.3, 1.0])
@pytest.mark.parametrize(
    ("vx_sigma_mps", "vx_offset_mps"), [(0.05, 0.0), (0.1, 0.0), (0.01, 0.12), (0.01, -0.12)]
)
def test_a_disturbed_speed_during_a_hold_does_not_prevent_the_start(
    slope_mps2: float, acceleration_mps2: float, vx_sigma_mps: float, vx_offset_mps: float
) -> None:
    def planner(car: RollingCar, time_s: float) -> PathReference:
        v_mps = acceleration_mps2 * (time_s - 10.0)
        if v_mps <= 0.0:
            return STRAIGHT
        if v_mps > 1.1:
            return STRAIGHT._replace(v_mps=1.1)
        return STRAIGHT._replace(v_mps=v_mps, a_mps2=acceleration_mps2)

    car = RollingCar(0.0, slope_mps2=slope_mps2)
    ticks = drive(car, planner, 22.0, np.random.default_rng(0), vx_sigma_mps, vx_offset_mps)
    held = [tick for tick in ticks if 2.0 < tick.time_s < 10.0]
    assert held[-1].s_m - held[0].s_m == pytest.approx(0.0, abs=1e-3)
    assert np.ptp([tick.control.steer_rad for tick in held]) == 0.0
    started = next(tick for tick in ticks if tick.vx_mps > 0.3)
    assert started.time_s < 10.0 + 0.7 / acceleration_mps2 + 1.0
    assert ticks[-1].vx_mps == pytest.approx(1.1 - vx_offset_mps, abs=0.2)


def test_the_pedals_do_not_jump_when_the_law_takes_over() -> None:
    car = RollingCar(6.0)
    planner = StopThenGo(12.0, 1.5, 6.0, 3.0)
    ticks = drive(car, planner, 10.0)
    k = next(k for k, tick in enumerate(ticks) if tick.law is Mode.LOW_SPEED)
    before, after = ticks[k - 1].control, ticks[k].control
    assert abs(after.brake_n - before.brake_n) * car.brake_mps2_per_n < 0.3
    assert abs(after.throttle - before.throttle) * car.throttle_mps2 < 0.3


def test_a_rolling_car_is_held_with_all_of_the_brake() -> None:
    law = LowSpeedLaw(ASSUMED)
    state = RollingCar(0.0).state()
    control = NEUTRAL_INPUT
    for _ in range(100):
        law.choose(state.vx_mps, STRAIGHT)
        control = law.control(state, 0.0, STRAIGHT, control)
    assert (law.law, control.brake_n) == (Mode.STANDSTILL, 75.0)
    state = state._replace(vx_mps=0.2)
    for _ in range(100):
        law.choose(state.vx_mps, STRAIGHT)
        control = law.control(state, 0.0, STRAIGHT, control)
    assert (law.law, control.brake_n) == (Mode.STANDSTILL, 150.0)


@pytest.mark.parametrize("slope_mps2", [2.0, 2.8])
def test_a_car_that_slips_through_its_hold_is_stopped_and_stays_on_the_path(
    slope_mps2: float,
) -> None:
    car = RollingCar(0.0, creep_mps2=0.0, brake_mps2_per_n=0.02, ey_m=0.2)

    def planner(car: RollingCar, time_s: float) -> PathReference:
        car.slope_mps2 = 0.0 if time_s < 2.0 else slope_mps2
        return STRAIGHT

    ticks = drive(car, planner, 10.0)
    assert max(tick.vx_mps for tick in ticks) < 0.7
    rolling = [tick for tick in ticks if tick.time_s > 2.0]
    assert {tick.law for tick in rolling} == {Mode.STANDSTILL}
    assert ticks[-1].vx_mps == 0.0
    is_steered = rolling[-1].control.steer_rad != rolling[0].control.steer_rad
    assert is_steered == any(tick.vx_mps >= ROLLING_MPS for tick in rolling)
