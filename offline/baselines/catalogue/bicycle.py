"""A fitted single-track model with saturating tyres, load transfer and lags.

It uses what the learned models use: the state, the past half second, curvature, and the inputs.
Along the past, its lags are simulated and an observer estimates what it cannot explain (gear,
engine speed and turbine speed are not measured); from there it is simulated. All its parameters
are fitted to the training part, on the error over the horizon.

Equations and units: `offline.baselines.single_track.kernel`.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from offline.baselines.baseline import Baseline
from offline.baselines.single_track.gauss_newton import begin, step
from offline.baselines.single_track.kernel import Bicycle, DriveMap, simulate
from offline.baselines.window_shape import require_windows
from offline.config import PAST_STEPS
from offline.data.dataset import Dataset
from offline.data.trajectories import Trajectories
from rt_controller.contract.arrays import Array
from rt_controller.contract.model.validation import DRIVABLE_HISTORY
from rt_controller.contract.schema import N_EXOGENOUS, N_INPUTS, N_STATES, VEHICLE
from rt_controller.report.table import Fact

SPEEDS_MPS = (2.0, 6.0, 10.0, 14.0, 18.0, 23.0, 28.0, 34.0, 42.0)
THROTTLES = (0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0)

_GUESSED_PEAK_MPS2 = 4.5
_GUESSED_POWER_W_PER_KG = 60.0

_ANY_SIGN = {
    "steering_give_rad_per_mps2", "curvature_front", "curvature_rear", "lift_front_per_m",
    "lift_rear_per_m", "roll_steer_front_rad_per_mps2", "roll_steer_rear_rad_per_mps2",
    "sway_m_per_mps2", "drive_share_front", "brake_share_front", "brake_above_knee",
    "surge_gain", "sway_gain", "swing_gain",
}  # fmt: skip
_LOWER_BOUND = {
    **dict.fromkeys(("relaxation_front_m", "relaxation_rear_m"), 0.25),
    **dict.fromkeys(("steering_lag_s", "throttle_lag_s", "drive_lag_s", "brake_lag_s"), 0.008),
}
"""faster dynamics would make the integrator unstable"""


@dataclass(frozen=True, slots=True)
class BicycleSettings:
    """Steps of Gauss-Newton on horizons of increasing length."""

    horizons: tuple[int, ...] = (10, 30, 80)
    steps: tuple[int, ...] = (10, 10, 60)
    windows: int = 128
    """drawn for each step"""
    test_windows: int = 768
    """on which a step has to lower the error"""
    seed: int = 0


@dataclass(frozen=True, slots=True)
class BicycleModel:
    """A fitted car."""

    parameters: Array
    """in the order of `Bicycle`"""
    drive_mps2: Array
    """(T, V) drive force per mass at `THROTTLES` and `SPEEDS_MPS`"""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, 6), as `Predictor.predict`."""
        signals = (N_STATES, N_INPUTS, N_EXOGENOUS)
        require_windows(x0, past, U, W, signals, len(DRIVABLE_HISTORY), PAST_STEPS)
        series = (past[:, -PAST_STEPS:], x0, U, W[:, :, 0])
        last, x0, U, kappa = (np.ascontiguousarray(each, dtype=np.float64) for each in series)
        car = Bicycle(*map(float, self.parameters))
        drive_map = DriveMap(np.array(SPEEDS_MPS), np.array(THROTTLES), self.drive_mps2)
        return simulate(last, x0, U, kappa, car, drive_map, VEHICLE.dt_s)

    def fit_info(self) -> tuple[Fact, ...]:
        """All fitted parameters, the unit at the end of the name."""
        parameters = [
            Fact(name, f"{value:.4g}")
            for name, value in zip(Bicycle._fields, self.parameters, strict=True)
        ]
        rows = []
        for throttle, row in zip(THROTTLES, self.drive_mps2, strict=True):
            pairs = zip(SPEEDS_MPS, row, strict=True)
            values = ", ".join(f"{drive:.2f} at {speed:g} m/s" for speed, drive in pairs)
            rows.append(Fact(f"drive in m/s^2, throttle {throttle:g}", values))
        return (*parameters, *rows)


def find_objection(dataset: Dataset) -> str | None:
    """The data have to be of the car's signals."""
    return None if dataset.schema == VEHICLE else "the data are not of the car's signals"


def fit_bicycle(dataset: Dataset, settings: BicycleSettings = BicycleSettings()) -> BicycleModel:
    """The car with the smallest two-second errors on the training part."""
    return descend(guessed_model(), dataset.select("train"), settings)


def guessed_model() -> BicycleModel:
    """The start of the fit: drive limited by power and grip, with engine drag."""
    speeds, throttles = np.array(SPEEDS_MPS), np.array(THROTTLES)
    drive = np.minimum(_GUESSED_PEAK_MPS2, _GUESSED_POWER_W_PER_KG * throttles[:, None] / speeds)
    return BicycleModel(np.array(Bicycle()), drive - 0.3)


def descend(start: BicycleModel, train: Trajectories, settings: BicycleSettings) -> BicycleModel:
    """The car that Gauss-Newton reaches from `start`, with other windows for every step."""
    rng = np.random.default_rng(settings.seed)
    theta, most = _to_theta(start), len(train.episode)
    trust = begin(len(theta))

    def draw(count: int) -> Trajectories:
        return train.take(rng.choice(most, min(count, most), replace=False))

    test = draw(settings.test_windows)
    for horizon, steps in zip(settings.horizons, settings.steps, strict=True):
        test_errors = partial(_errors, test, horizon)
        for _ in range(steps):
            errors = partial(_errors, draw(settings.windows), horizon)
            theta, trust = step(theta, errors, test_errors, trust)
    return _from_theta(theta)


def _errors(windows: Trajectories, horizon: int, theta: Array) -> Array:
    """(batch, horizon, 6) predicted minus measured."""
    x, u, w, past = (series.astype(np.float64) for series in windows[:4])
    predicted = _from_theta(theta).predict(x[:, 0], past, u[:, :horizon], w[:, :horizon])
    return (predicted - x[:, : horizon + 1])[:, 1:]


def _to_theta(model: BicycleModel) -> Array:
    """Unbounded parameters: logarithms of those with a lower bound, and the drive map."""
    free = [
        value if name in _ANY_SIGN else np.log(value - _LOWER_BOUND.get(name, 0.0))
        for name, value in zip(Bicycle._fields, model.parameters, strict=True)
    ]
    return np.concatenate([free, model.drive_mps2.ravel()])


def _from_theta(theta: Array) -> BicycleModel:
    parameters = [
        value if name in _ANY_SIGN else np.exp(value) + _LOWER_BOUND.get(name, 0.0)
        for name, value in zip(Bicycle._fields, theta, strict=False)
    ]
    drive = theta[len(parameters) :].reshape(len(THROTTLES), len(SPEEDS_MPS))
    return BicycleModel(np.array(parameters), drive)


BASELINE = Baseline(fit=fit_bicycle, find_objection=find_objection)
