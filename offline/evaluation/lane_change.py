"""The paper's double lane change, open loop: the same inputs to the car and to every model.

A driver model steers the simulated car through the shipped scenario; its inputs, limited as the
controller's are, are given to the models. Predictions are windows of 2 s in a row: each starts
from the measured state, is lifted once, and ends where the next begins.
Paper: section IV, figure "trajectory comparison".
"""

from typing import NamedTuple

import numpy as np

from offline.config import PAST_STEPS, STEPS
from offline.data.recording import Anchor, Recording, Starts, cut, onto_road
from offline.data.signals import VEHICLE_ROLES, Trajectories
from rt_controller.contract.arrays import Array
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import VEHICLE, ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.plant.parameters import default_car, with_road_friction
from sim_bridge.scenario import Scenario, load_scenario
from sim_bridge.validation.driver_model import PreviewDriver, fit_driver_model
from sim_bridge.validation.run import Observation, run_driver

SCENARIO = "double_lane_change"
WINDOWS = 4
"""of 2 s, after half a second of past: the whole manoeuvre"""
PREVIEW_S = 0.6


class LaneChange(NamedTuple):
    """A drive in W windows of 2 s, each beginning where the one before ends."""

    scenario: Scenario
    windows: Trajectories
    desired_ey_m: Array
    """(W, K+1) of the scenario, at the position of the car"""

    @property
    def description(self) -> str:
        """Speed, road and lateral displacement, as text."""
        road = self.scenario
        ground = road.road_at(0.0, 0.0)
        lateral_m = float(np.abs(self.desired_ey_m).max())
        return (
            f"{3.6 * road.start.speed_mps:g} km/h on a road of curvature "
            f"{ground.curvature_per_m:g} 1/m and friction {ground.friction_left:g}, "
            f"{lateral_m:.2g} m to the side and back"
        )

    @property
    def time_s(self) -> Array:
        """(W, K+1) since the start of the first window."""
        steps = STEPS * np.arange(WINDOWS)[:, None] + np.arange(STEPS + 1)
        return PERIOD_S * steps.astype(np.float64)


def drive_lane_change() -> LaneChange:
    """The shipped scenario, driven by a preview driver in the car of the training data."""
    scenario = load_scenario(SCENARIO)
    ground, speed_mps = scenario.road_at(0.0, 0.0), scenario.start.speed_mps
    curvature_per_m = ground.curvature_per_m
    car = with_road_friction(default_car(), ground.friction_left)
    driver_model = fit_driver_model(car, speed_mps)
    driver = PreviewDriver(lambda x_m: _path_y_m(scenario, x_m), PREVIEW_S, driver_model)
    change = PERIOD_S * np.array(INPUT_LIMITS.rate_per_s)
    last: Array | None = None

    def limited(now: Observation) -> ControlInput:
        """The driver's inputs within the limits and rates of the controller's inputs."""
        nonlocal last
        wanted = np.clip(driver(now), INPUT_LIMITS.lower, INPUT_LIMITS.upper)
        last = wanted if last is None else np.clip(wanted, last - change, last + change)
        return ControlInput(*last.tolist())

    periods = PAST_STEPS + WINDOWS * STEPS
    run = run_driver(car, speed_mps, limited, periods * PERIOD_S, PERIOD_S)

    # An input row of a run holds for the period that ends there, that of a recording for the
    # period that begins there.
    recording = Recording(
        x=run.motion.astype(np.float32),
        u=np.vstack([run.inputs[1:], run.inputs[-1:]]).astype(np.float32),
        w=np.full((periods + 1, 1), curvature_per_m, dtype=np.float32),
        pose=run.pose,
        first=np.zeros(1, dtype=np.int64),
    )
    row = PAST_STEPS + STEPS * np.arange(WINDOWS)
    start = Anchor(np.array([curvature_per_m]), np.zeros(1), np.zeros(1))
    s_m, ey_m, epsi_rad = (part[0] for part in onto_road(run.pose[None], start))
    anchor = Anchor(np.full(WINDOWS, curvature_per_m), ey_m[row - 1], epsi_rad[row - 1])
    starts = Starts(row, np.zeros(WINDOWS, dtype=np.int32), anchor)
    ahead = row[:, None] + np.arange(STEPS + 1)
    windows = cut(recording, starts, VEHICLE, VEHICLE_ROLES)
    return LaneChange(scenario, windows, scenario.ey_m(s_m[ahead]))


def _path_y_m(scenario: Scenario, x_m: Array) -> Array:
    """y (N,) of the scenario's path at x (N,); the road is a circle that starts along x."""
    radius_m = 1.0 / scenario.road_at(0.0, 0.0).curvature_per_m
    beside: Array | float = radius_m
    # One fixed-point iteration from the road to the path beside it is exact to millimetres.
    for _ in range(2):
        beside = radius_m - scenario.ey_m(radius_m * np.arcsin(x_m / beside))
    return np.asarray(radius_m - np.sqrt(beside**2 - x_m**2))
