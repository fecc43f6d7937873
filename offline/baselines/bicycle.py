"""A physical rival: a fitted single-track car with saturating tyres, load transfer and lags.

It sees what the learned models see: the state, the last half second, curvature, and the inputs.
Along the past its lags and an estimate of what it cannot explain (gear, engine and turbine speed
are hidden) are brought to the present; from there it is simulated. Every one of its numbers is
fitted to the training part, on the error over the horizon.

Equations and units: `offline.baselines.bicycle_kernel`.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from offline.baselines.bicycle_kernel import Bicycle, roll_out
from offline.baselines.finding import Finding
from offline.baselines.gauss_newton import begin, log_error_of, step
from offline.baselines.window_shape import WindowShape
from offline.dataset import Dataset
from offline.lengths import PAST_STEPS
from offline.trajectories import Trajectories
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.schema import VEHICLE

Array = NDArray[np.float64]

SPEEDS_MPS = (2.0, 6.0, 10.0, 14.0, 18.0, 23.0, 28.0, 34.0, 42.0)
THROTTLES = (0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0)

GUESS = Bicycle(
    front_axle_m=1.1,
    rear_axle_m=1.5,
    gyration_m2=1.8,
    height_m=0.5,
    steering_ratio=18.0,
    steering_lag_s=0.04,
    steering_give_rad_per_mps2=0.0,
    stiffness_front_per_rad=12.0,
    stiffness_rear_per_rad=14.0,
    friction_front=1.0,
    friction_rear=1.0,
    shape_front=1.4,
    shape_rear=1.4,
    curvature_front=0.0,
    curvature_rear=0.0,
    relaxation_front_m=0.5,
    relaxation_rear_m=0.5,
    lift_front_per_m=0.0,
    lift_rear_per_m=0.0,
    roll_radps=10.0,
    roll_damping=0.4,
    roll_steer_front_rad_per_mps2=0.0,
    roll_steer_rear_rad_per_mps2=0.0,
    sway_m_per_mps2=0.0,
    throttle_lag_s=0.15,
    drive_lag_s=0.1,
    drive_share_front=0.5,
    brake_mps2_per_n=0.06,
    brake_knee_n=60.0,
    brake_above_knee=0.8,
    brake_lag_s=0.06,
    brake_share_front=0.65,
    rolling_mps2=0.1,
    drag_per_m=3e-4,
    surge_gain=0.2,
    surge_memory_s=0.5,
    sway_gain=0.1,
    sway_memory_s=0.3,
    swing_gain=0.1,
    swing_memory_s=0.3,
)
"""a mid-size car as anybody might guess it, before any data are seen"""

_GUESSED_PEAK_MPS2 = 4.5
_GUESSED_POWER_W_PER_KG = 60.0

_ANY_SIGN = {
    "steering_give_rad_per_mps2",
    "curvature_front",
    "curvature_rear",
    "lift_front_per_m",
    "lift_rear_per_m",
    "roll_steer_front_rad_per_mps2",
    "roll_steer_rear_rad_per_mps2",
    "sway_m_per_mps2",
    "drive_share_front",
    "brake_share_front",
    "brake_above_knee",
    "surge_gain",
    "sway_gain",
    "swing_gain",
}

_FLOOR = {
    **dict.fromkeys(("relaxation_front_m", "relaxation_rear_m"), 0.25),
    **dict.fromkeys(("steering_lag_s", "throttle_lag_s", "drive_lag_s", "brake_lag_s"), 0.008),
}
"""what is faster cannot be followed by the integrator"""


@dataclass(frozen=True, slots=True)
class BicycleSettings:
    """The schedule of the fit: steps of Gauss-Newton on ever longer horizons."""

    horizons: tuple[int, ...] = (10, 30, 80)
    steps: tuple[int, ...] = (10, 10, 60)
    windows: int = 128
    """drawn for each step"""
    judged_windows: int = 768
    """that a step must be a gain on"""
    past_steps: int = PAST_STEPS
    seed: int = 0


@dataclass(frozen=True, slots=True)
class BicycleModel:
    """A fitted car."""

    numbers: Array
    """in the order of `Bicycle`"""
    speeds_mps: Array
    """(V,) of the map"""
    throttles: Array
    """(T,)"""
    drive_mps2: Array
    """(T, V) drive per mass"""
    past_steps: int

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, 6).

        Raises:
            DatasetError: the shapes are not those of the car's windows.
        """
        WindowShape(6, 3, 1, 6, self.past_steps).require(x0, past, U, W)
        return roll_out(
            np.ascontiguousarray(past[:, past.shape[1] - self.past_steps :], dtype=np.float64),
            np.ascontiguousarray(x0, dtype=np.float64),
            np.ascontiguousarray(U, dtype=np.float64),
            np.ascontiguousarray(W[:, :, 0], dtype=np.float64),
            Bicycle(*(float(number) for number in self.numbers)),
            self.speeds_mps,
            self.throttles,
            self.drive_mps2,
            VEHICLE.dt_s,
        )

    def findings(self) -> tuple[Finding, ...]:
        """Every fitted number, the unit at the end of its name."""
        numbers = [
            Finding(name, f"{value:.4g}")
            for name, value in zip(Bicycle._fields, self.numbers, strict=True)
        ]
        rows = [
            Finding(
                f"drive in m/s^2, throttle {throttle:g}",
                ", ".join(
                    f"{drive:.2f} at {speed:g} m/s"
                    for speed, drive in zip(self.speeds_mps, row, strict=True)
                ),
            )
            for throttle, row in zip(self.throttles, self.drive_mps2, strict=True)
        ]
        return (*numbers, *rows)


def fit_bicycle(dataset: Dataset, settings: BicycleSettings = BicycleSettings()) -> BicycleModel:
    """The car whose two-second errors on the training part are least.

    Raises:
        DatasetError: the data are not of the car's signals.
    """
    if dataset.schema != VEHICLE:
        raise DatasetError(
            f"expected data of the car's signals, {', '.join(VEHICLE.state_names)}, to fit a "
            f"single-track car to, found {', '.join(dataset.schema.state_names)}. Leave out the "
            f"rival bicycle."
        )
    return descend(guessed_model(settings.past_steps), dataset.select("train"), settings)


def guessed_model(past_steps: int) -> BicycleModel:
    """The car before any data are seen: power and grip limit its drive, and the engine drags."""
    speeds, throttles = np.array(SPEEDS_MPS), np.array(THROTTLES)
    drive = np.minimum(_GUESSED_PEAK_MPS2, _GUESSED_POWER_W_PER_KG * throttles[:, None] / speeds)
    return BicycleModel(np.array(GUESS), speeds, throttles, drive - 0.3, past_steps)


def descend(start: BicycleModel, train: Trajectories, settings: BicycleSettings) -> BicycleModel:
    """The car that Gauss-Newton finds from `start`, on windows drawn anew for every step."""
    rng = np.random.default_rng(settings.seed)
    theta = _to_theta(start)
    trust = begin(len(theta))
    many = _draw(train, settings.judged_windows, rng)
    for horizon, steps in zip(settings.horizons, settings.steps, strict=True):
        judged = partial(_log_error, many, horizon, start)
        for _ in range(steps):
            few = _draw(train, settings.windows, rng)
            theta, trust = step(theta, partial(_errors, few, horizon, start), judged, trust)
    return _from_theta(theta, start)


def _draw(train: Trajectories, count: int, rng: np.random.Generator) -> Trajectories:
    most = len(train.episode)
    return train.take(rng.choice(most, min(count, most), replace=False))


def _log_error(windows: Trajectories, horizon: int, like: BicycleModel, theta: Array) -> float:
    return log_error_of(_errors(windows, horizon, like, theta))


def _errors(windows: Trajectories, horizon: int, like: BicycleModel, theta: Array) -> Array:
    """(batch, horizon, 6) predicted minus measured."""
    x, u, w, past = (series.astype(np.float64) for series in windows[:4])
    predicted = _from_theta(theta, like).predict(x[:, 0], past, u[:, :horizon], w[:, :horizon])
    return (predicted - x[:, : horizon + 1])[:, 1:]


def _to_theta(model: BicycleModel) -> Array:
    """Numbers that may be anything: logarithms of what must be positive, above its floor."""
    free = [
        value if name in _ANY_SIGN else np.log(value - _FLOOR.get(name, 0.0))
        for name, value in zip(Bicycle._fields, model.numbers, strict=True)
    ]
    return np.concatenate([free, model.drive_mps2.ravel()])


def _from_theta(theta: Array, like: BicycleModel) -> BicycleModel:
    numbers = [
        value if name in _ANY_SIGN else np.exp(value) + _FLOOR.get(name, 0.0)
        for name, value in zip(Bicycle._fields, theta, strict=False)
    ]
    drive = theta[len(numbers) :].reshape(like.drive_mps2.shape)
    return BicycleModel(np.array(numbers), like.speeds_mps, like.throttles, drive, like.past_steps)
