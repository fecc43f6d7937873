"""A plain driver that follows the reference of a scenario with the own car, without a bus."""

from dataclasses import dataclass
from math import atan, isfinite

import numpy as np
from made_frames import round_trip

from rt_controller.bus.messages import REFERENCE
from rt_controller.contract.signals import ControlInput, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.scenario import Scenario
from sim_bridge.scenario.metrics import LogRow, Metrics, measure
from sim_bridge.scenario.speed import next_progress
from sim_bridge.session import build_car

WHEELBASE_M, STEERING_RATIO, UNDERSTEER_S2PM2 = 2.91, 18.5, 0.0022
WHEEL_RAD = 6.0
FOLLOWING_RADPS = 1.8
"""bandwidth of position and heading"""
PREVIEW_S = 0.15


@dataclass(frozen=True, slots=True)
class DrivenScenario:
    """What happened."""

    metrics: Metrics
    ticks: int
    s_m: float


def follow(state: VehicleState, path: PathReference, curvature_per_m: float) -> ControlInput:
    """Steering by curvature, position and heading; pedals by speed."""
    vx_mps = max(state.vx_mps, 1.0)
    bend = curvature_per_m + 2.0 * path.c2_per_m + 6.0 * path.c3_per_m2 * PREVIEW_S * vx_mps
    wanted_mps2 = -(FOLLOWING_RADPS**2) * (state.ey_m - path.c0_m) - 1.8 * (
        FOLLOWING_RADPS * vx_mps * (state.epsi_rad - atan(path.c1))
    )
    turn = bend + float(np.clip(wanted_mps2, -2.0, 2.0)) / vx_mps**2
    steer = STEERING_RATIO * WHEELBASE_M * (1.0 + UNDERSTEER_S2PM2 * vx_mps**2) * turn
    steer_rad = float(np.clip(steer, -WHEEL_RAD, WHEEL_RAD))
    if path.v_mps == 0.0 and abs(state.vx_mps) < 0.5:
        return ControlInput(0.0, 80.0, steer_rad)
    wanted_mps2 = path.a_mps2 + 1.5 * (path.v_mps - state.vx_mps)
    if wanted_mps2 < -0.4:
        return ControlInput(0.0, min(150.0, -19.0 * wanted_mps2), steer_rad)
    pedal = (0.12 + 0.18 * wanted_mps2) * min(1.0, 0.4 + 0.06 * vx_mps)  # low gears pull more
    return ControlInput(float(np.clip(pedal, 0.0, 1.0)), 0.0, steer_rad)


def drive(scenario: Scenario, ticks: int | None = None) -> DrivenScenario:
    """Drive with the own car; fails if a state is not finite or a path does not fit the frames."""
    car = build_car(scenario)
    frame, log = scenario.road.curvature_per_m, list[LogRow]()
    progress, state, done = scenario.first_progress, car.state, 0
    for tick in range(min(scenario.ticks, ticks or scenario.ticks)):
        time_s = tick * PERIOD_S
        ground = scenario.road_at(car.s_m, time_s)
        path = scenario.path_ahead(car.s_m, state.vx_mps, time_s, progress)
        assert all(map(isfinite, path)), f"path {path} at s = {car.s_m}"
        assert round_trip(REFERENCE, path) is not None, f"{path} does not fit the frames"
        car.set_road(ground)
        control = follow(state, path, ground.curvature_per_m)
        state = car.advance(control, frame)
        assert car.is_sound, f"{car.plant.failure} after {tick} ticks"
        progress = next_progress(progress, scenario.stops, car.s_m, state.vx_mps, time_s + PERIOD_S)
        done = tick + 1
        log.append(
            LogRow(
                time_s + PERIOD_S, car.s_m, state.ey_m, state.epsi_rad, ground.curvature_per_m,
                state.vx_mps, state.vy_mps, state.yaw_rate_radps, control.steer_rad,
                path.c0_m, atan(path.c1), path.v_mps,
                progress.stops_done if progress.is_holding else -1,
            )
        )  # fmt: skip
        if car.s_m >= scenario.end_m:
            break
    return DrivenScenario(measure(log, scenario.stops, scenario.course), done, car.s_m)
