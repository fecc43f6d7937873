"""A scenario as it is driven: where the car is in it, the path from there on, and the figures."""

from math import atan, hypot

import numpy as np

from rt_controller.contract.signals import ControlInput, Mode, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S
from rt_controller.drive.scenario import CarFigure
from rt_controller.vehicle.vehicle_envelope import OwnMotion, off_path_m
from sim_bridge.car import Car
from sim_bridge.scenario import Scenario
from sim_bridge.scenario.metrics import LogRow, judged, measure, peak, rms
from sim_bridge.scenario.speed import next_progress

AT_REST_MPS = 0.3
"""speed below which a safe stop has brought the car to rest, as for the controller"""


class ScenarioRun:
    """The progress of one drive; `drive` moves the car and notes where it is."""

    def __init__(self, scenario: Scenario, state: VehicleState, s_m: float) -> None:
        """The car waits at the start, in this state and at this arc length."""
        self.scenario = scenario
        self.ticks = self.end_ticks = 0
        """since the start; since the end of the mission"""
        self.time_s = 0.0
        """since the car was first driven"""
        self._is_end_requested = False
        self._progress = scenario.first_progress
        self._log: list[LogRow] = []
        self.state, self._sampled_m = state, s_m
        self.path = scenario.path_ahead(s_m, state.vx_mps)
        """what a path planner sends from where the car is"""
        self._place(state, s_m)

    def _place(self, state: VehicleState, s_m: float) -> None:
        """Note where the car is at the end of a period."""
        self._before, self.state, self.s_m = self.state, state, s_m
        self.speed_mps = hypot(state.vx_mps, state.vy_mps)
        self.curvature_per_m = self.scenario.road.curvature_per_m.at(s_m)
        """of the road at the car"""
        self.ey_error_m = state.ey_m - self.path.c0_m
        """distance from the wanted position"""
        away_m = off_path_m(self.path, state, self.curvature_per_m)
        self.motion = OwnMotion(self.speed_mps, away_m, self.end_ticks == 0)
        """of the car, by its own measurement"""

    def sample(self, age_s: float) -> tuple[VehicleState, float, PathReference]:
        """State, arc length and path `age_s` ago; its progress is that since the last sample.

        Between two periods everything is linear in time.
        """
        state, s_m, path = self.state, self.s_m, self.path
        if age_s > 0.0:
            share = age_s / PERIOD_S
            pairs = zip(self._before, state, strict=True)
            s_m -= share * state.ds_m
            state = VehicleState(*(now + share * (before - now) for before, now in pairs))
            time_s = max(self.time_s - age_s, 0.0)
            path = self.scenario.path_ahead(s_m, state.vx_mps, time_s, self._progress)
        if self.ticks > 0:
            state = state._replace(ds_m=s_m - self._sampled_m)
        self._sampled_m = s_m
        return state, s_m, path

    @property
    def is_moving(self) -> bool:
        """False if a stop has brought the car to rest."""
        return self.speed_mps > AT_REST_MPS

    def end_mission(self) -> None:
        """End the mission with the next period, as if the duration of the scenario were over."""
        self._is_end_requested = True

    def drive(
        self, car: Car, applied: ControlInput, mode: Mode | None, is_braking: bool = False
    ) -> bool:
        """Move the car by one period on its road; False if its motion is not sound any more.

        Then the run stays where it was.

        Args:
            car: of this run.
            applied: input of the period.
            mode: of the command that is followed; None: there was none.
            is_braking: the vehicle brakes by itself.
        """
        scenario = self.scenario
        car.set_road(scenario.road_at(self.s_m, self.time_s))
        state = car.advance(applied, scenario.road.curvature_per_m)
        if not car.is_sound:
            return False
        self.ticks += 1
        self.time_s = self.ticks * PERIOD_S
        s_m, speed_mps = car.s_m, state.vx_mps
        self._progress = next_progress(
            self._progress, scenario.all_stops, s_m, speed_mps, self.time_s
        )
        self.path = scenario.path_ahead(s_m, speed_mps, self.time_s, self._progress)
        self._place(state, s_m)
        if not self._is_mission_on(mode, is_braking):
            self.end_ticks += 1
            self.motion = self.motion._replace(is_mission_on=False)
            return True
        stop = self._progress.stops_done if self._progress.is_holding else -1
        vx_mps, vy_mps, yaw_rate_radps, _, ey_m, epsi_rad = state
        place = self.time_s, s_m, ey_m, epsi_rad, self.curvature_per_m
        motion = vx_mps, vy_mps, yaw_rate_radps, applied.steer_rad
        wanted = self.path.c0_m, atan(self.path.c1), self.path.v_mps
        self._log.append(LogRow(*place, *motion, *wanted, stop))
        return True

    def figures(self) -> tuple[CarFigure, ...]:
        """The figures that the scenario names or limits, so far."""
        scenario = self.scenario
        found = measure(self._log, scenario.all_stops, scenario.course, scenario.road.width_m)
        return judged(found, scenario.metrics, scenario.limits)

    def ey_error_rms_and_peak_m(self) -> tuple[float, float]:
        """Of the lateral error, so far."""
        errors_m = np.array([row.ey_m - row.wanted_ey_m for row in self._log])
        return rms(errors_m), peak(errors_m)

    def _is_mission_on(self, mode: Mode | None, is_braking: bool) -> bool:
        """True during the scenario, and after it until a safe stop has brought the car to rest."""
        if self.end_ticks > 0:
            return False
        if is_braking:
            return self.is_moving
        is_at_end = self.ticks >= self.scenario.ticks or self.s_m >= self.scenario.end_m
        return not (is_at_end or self._is_end_requested) or (
            mode is Mode.SAFE_STOP and self.is_moving
        )
