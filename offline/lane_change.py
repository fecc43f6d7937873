"""The paper's double lane change, open loop: the same inputs to the car and to every model.

A preview driver takes the simulated car through the shipped scenario; his inputs, box and rates
as the controller's, are what the models are given. Predictions are windows of 2 s in a row: each
starts from the measured state, is lifted once, and ends where the next begins.
Paper: section IV, figure "trajectory comparison".
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from offline.lengths import PAST_STEPS, STEPS
from offline.predictor import Predictor
from offline.recording import Recording, Starts, cut
from offline.road_frame import Anchor, RoadPose, onto_road
from offline.roles import VEHICLE_ROLES
from offline.trajectories import Trajectories
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.schema import VEHICLE
from rt_controller.contract.signals import ControlInput
from rt_controller.contract.timing import PERIOD_S
from sim_bridge.plant.parameters import C_CLASS_150KW_AWD, with_road_friction
from sim_bridge.scenario import Scenario, load_scenario
from sim_bridge.validation.preview import PreviewDriver, get_familiar
from sim_bridge.validation.run import Moment, drive

Array = NDArray[np.float64]

SCENARIO = "double_lane_change"
WINDOWS = 4
"""of 2 s, after half a second of past: the whole manoeuvre at its speed"""
PREVIEW_S = 0.6


class LaneChange(NamedTuple):
    """A drive in windows of 2 s, each beginning where the one before ends."""

    scenario: Scenario
    windows: Trajectories
    wanted_ey_m: Array
    """(W, K+1) of the scenario at the car's place"""

    @property
    def words(self) -> str:
        """The manoeuvre, for people."""
        road = self.scenario
        aside_m = max(abs(move.to_m) for move in road.moves)
        return (
            f"{3.6 * road.speed_mps:g} km/h on a road of curvature {road.curvature_per_m:g} 1/m "
            f"and friction {road.road_friction:g}, {aside_m:g} m aside and back"
        )

    @property
    def time_s(self) -> Array:
        """(W, K+1) since the first window's start."""
        steps = STEPS * np.arange(WINDOWS)[:, None] + np.arange(STEPS + 1)
        return PERIOD_S * steps.astype(np.float64)


def drive_lane_change() -> LaneChange:
    """The shipped scenario with a driver at the wheel of the car that the data were made with."""
    scenario = load_scenario(SCENARIO)
    car = with_road_friction(C_CLASS_150KW_AWD, scenario.road_friction)
    driver = _WithinLimits(
        PreviewDriver(
            lambda x_m: _path_over_ground(scenario, x_m),
            PREVIEW_S,
            get_familiar(car, scenario.speed_mps),
        )
    )
    periods = PAST_STEPS + WINDOWS * STEPS
    run = drive(car, scenario.speed_mps, driver, periods * PERIOD_S, PERIOD_S)

    # A run's input rows hold for the period that ends there, a recording's from there on.
    recording = Recording(
        x=run.motion.astype(np.float32),
        u=np.vstack([run.inputs[1:], run.inputs[-1:]]).astype(np.float32),
        w=np.full((periods + 1, 1), scenario.curvature_per_m, dtype=np.float32),
        pose=run.pose,
        first=np.zeros(1, dtype=np.int64),
    )
    row = PAST_STEPS + STEPS * np.arange(WINDOWS)
    along = _along_the_road(scenario, run.pose)
    before = row - 1
    anchor = Anchor(
        np.full(WINDOWS, scenario.curvature_per_m), along.ey_m[before], along.epsi_rad[before]
    )
    starts = Starts(row, np.zeros(WINDOWS, dtype=np.int32), anchor)
    ahead = row[:, None] + np.arange(STEPS + 1)
    return LaneChange(
        scenario,
        cut(recording, starts, VEHICLE, VEHICLE_ROLES),
        scenario.lateral_m(along.s_m[ahead]),
    )


def predict_windows(model: Predictor, windows: Trajectories) -> Array:
    """States (W, K+1, n) that the model foresees in each window."""
    x, u, w, past = (array.astype(np.float64) for array in windows[:4])
    return model.predict(x[:, 0], past, u, w)


class _WithinLimits:
    """A driver whose hands and feet are as fast and as strong as the controller's box says."""

    def __init__(self, driver: PreviewDriver) -> None:
        self._driver = driver
        self._last: ControlInput | None = None

    def __call__(self, now: Moment) -> ControlInput:
        wanted = np.clip(self._driver(now), INPUT_LIMITS.lower, INPUT_LIMITS.upper)
        last = wanted if self._last is None else np.array(self._last)
        reach = PERIOD_S * np.array(INPUT_LIMITS.rate_per_s)
        self._last = ControlInput(*np.clip(wanted, last - reach, last + reach).tolist())
        return self._last


def _path_over_ground(scenario: Scenario, x_m: Array) -> Array:
    """y (N,) of the scenario's path at x (N,), the road being a circle that starts along x."""
    radius_m = 1.0 / scenario.curvature_per_m
    lateral = scenario.lateral_m(radius_m * np.arcsin(x_m / radius_m))
    beside = radius_m - lateral
    # Where the path, not the road, is at x: one turn of the fixed point is exact to millimetres.
    lateral = scenario.lateral_m(radius_m * np.arcsin(x_m / beside))
    beside = radius_m - lateral
    return np.asarray(radius_m - np.sqrt(beside**2 - x_m**2))


def _along_the_road(scenario: Scenario, pose: Array) -> RoadPose:
    start = Anchor(np.array([scenario.curvature_per_m]), np.zeros(1), np.zeros(1))
    return RoadPose(*(part[0] for part in onto_road(pose[None], start)))
