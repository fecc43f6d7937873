"""Fit of the simulated car to recorded drives: windows, least squares, intervals, judgement.

A window begins with the measured speed, lateral speed and yaw rate; pedals and steering wheel of
the recording drive the car to its end, without feedback. What is not measured at the start (slips,
engine, gear, brake pressure) comes from a drive before it in which these three are kept at the
measured ones.

The residuals within a window are correlated: a wrong start or an unmodelled slope acts to its end.
So the covariance is the jackknife over whole windows, to first order (Bell and McCaffrey, Survey
Methodology 28, 2002, as CR3).
"""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import ceil, isfinite, log, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import savgol_filter
from scipy.stats import t as student_t

from offline.data.dataset import Dataset
from offline.data.manifest import Part
from offline.evaluation.car_parameters import Fitted, car_with
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.signals import VEHICLE, ControlInput
from sim_bridge.plant.library import STEP_S, advance, car_record, settle, simulate
from sim_bridge.plant.parameters import Parameters
from sim_bridge.plant.protocol import FASTEST_START_MPS
from sim_bridge.plant.states import AT, N_WHEELS

SIGNALS = ("vx_mps", "vy_mps", "yaw_rate_radps")
"""states that are compared, in the order of the columns here"""
FIT_S, JUDGE_S, LEAD_S = 5.0, 10.0, 1.0
"""length of a window of the fit, of the judgement, and of the drive before a window"""
LEAST_WINDOWS = 6
LARGEST_STD_MPS = 0.03
"""of an estimated lateral speed that is compared; a less exact one comes from the yaw rate, and
tells nothing more"""
_FEW = 15
"""windows with which the fit begins"""
_LEAST_SPEED_MPS = 3.0
_HISTORY_S, _SMOOTHING_S, _LARGEST_STEP_S = 4.0, 0.5, 0.002
_FIRST_SCALES = np.array([0.3, 0.03, 0.01])
"""errors that count equally in the first fit; the second takes the RMS errors that remain"""
_STEP = 5e-3
_PRIOR = 1.0
"""standard deviation of a coordinate beyond which only the drives pull it"""
LARGEST_HALF_WIDTH = log(2.0)
"""of a coordinate's interval; if a wider one contains the base car's value, it is not told"""


@dataclass(frozen=True, slots=True)
class Drive:
    """An episode of a data set."""

    inputs: Array
    """(n, 3) as `ControlInput`, each held until the next sample"""
    measured: Array
    """(n, 3) as `SIGNALS`; NaN: not measured"""
    smooth: Array
    """(n, 3), with less noise, for the starts"""
    period_s: float

    @property
    def steps_per_period(self) -> int:
        """Of the fit; half as many as in a simulation give the same motion to 1e-6."""
        return ceil(self.period_s / _LARGEST_STEP_S)

    @property
    def step_s(self) -> float:
        return self.period_s / self.steps_per_period

    def periods(self, duration_s: float) -> int:
        return round(duration_s / self.period_s)


@dataclass(frozen=True, slots=True)
class Window:
    """A part of a drive, and the state of the car from which its lead begins."""

    drive: Drive
    begin: int
    """row of the first compared sample"""
    end: int
    """row after the last one"""
    state: Array
    """(N_STATES,) `LEAD_S` before the begin"""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A parameter after the fit."""

    parameter: Fitted
    coordinate: float
    half_width: float
    """of the 95 % interval of the coordinate; NaN if the drives do not tell it"""
    is_at_bound: bool

    @property
    def is_told(self) -> bool:
        return bool(np.isfinite(self.half_width))

    def interval(self, base: Parameters) -> tuple[float, float, float]:
        """Value, and low and high end of its 95 % interval; NaN if it is not told."""
        ends = self.coordinate + np.array((0.0, -self.half_width, self.half_width))
        inside = np.clip(ends, *self.parameter.bounds(base)).tolist()
        value, low, high = (self.parameter.value(base, each) for each in inside)
        return value, low, high


@dataclass(frozen=True, slots=True)
class CarFit:
    """Parameters and car, with what the interval of a derived number needs."""

    car: Parameters
    estimates: tuple[Estimate, ...]
    covariance: Array
    """of the coordinates that are told, in their order"""
    quantile: float
    """of 95 % intervals"""
    windows: int


class Judgement(NamedTuple):
    """Errors of a car on drives, over windows of `JUDGE_S` from measured starts."""

    yaw_rate_error_percent: float
    """RMS error over RMS"""
    lateral_speed_error_percent: float
    """likewise; NaN if it is not measured"""
    speed_error_percent: float
    """RMS error over the range of the measured speed"""
    judged_s: float


def drives_of(dataset: Dataset, parts: Sequence[Part]) -> list[Drive]:
    """The episodes of these parts.

    Raises:
        DatasetError: a signal other than the lateral speed is missing, or the period is not a
            multiple of 1 ms.
    """
    schema, recording = dataset.schema, dataset.recording
    speed, lateral, yaw_rate = SIGNALS
    inputs = tuple(signal.name for signal in VEHICLE.inputs)
    missing = [name for name in (speed, yaw_rate) if name not in schema.state_names]
    missing += [name for name in inputs if name not in schema.input_names]
    if missing:
        raise DatasetError(
            f"expected a data set with {', '.join((speed, yaw_rate, *inputs))}, found one without "
            f"{', '.join(missing)}. Name the columns in the mapping of offline-import."
        )
    periods = schema.dt_s / STEP_S
    if abs(periods - round(periods)) > 1e-6:
        raise DatasetError(
            f"expected a period of whole milliseconds, found {1e3 * schema.dt_s:g} ms. Import the "
            f"logs with another period."
        )
    std_mps = getattr(dataset.origin, "lateral_speed_std_mps", None) or 0.0
    is_compared = lateral in schema.state_names and std_mps <= LARGEST_STD_MPS
    names = (speed, lateral if is_compared else speed, yaw_rate)
    columns = [schema.input_names.index(name) for name in inputs]
    states = [schema.state_names.index(name) for name in names]
    drives = []
    for part in parts:
        for episode in dataset.episodes(part):
            first = int(recording.first[episode])
            rows = slice(first, first + int(recording.lengths[episode]))
            measured = recording.x[rows][:, states].astype(float)
            size = 2 * round(0.5 * _SMOOTHING_S / schema.dt_s) + 1
            smooth = savgol_filter(measured, size, 3, axis=0) if size > 4 else measured.copy()
            if not is_compared:
                measured[:, 1] = smooth[:, 1] = nan
            drives.append(
                Drive(recording.u[rows][:, columns].astype(float), measured, smooth, schema.dt_s)
            )
    return drives


def windows_of(
    car: Parameters, drives: Iterable[Drive], length_s: float, most: int | None = None
) -> list[Window]:
    """Windows that follow each other, in which the car is faster than 3 m/s.

    The state before each is that of `car`, which follows the drive for 4 s. `most` are spread over
    all that there are.
    """
    places = [(drive, begin) for drive in drives for begin in _begins(drive, length_s)]
    if most is not None and len(places) > most:
        places = [places[k] for k in np.linspace(0, len(places) - 1, most).round().astype(int)]

    def window(place: tuple[Drive, int]) -> Window:
        drive, begin = place
        until = begin - drive.periods(LEAD_S)
        since = max(0, until - drive.periods(_HISTORY_S))
        state = settle(max(0.0, float(drive.smooth[since, 0])), car)
        _follow(state, car, car_record(car), drive, since, until)
        return Window(drive, begin, begin + drive.periods(length_s), state)

    with ThreadPoolExecutor() as pool:
        return list(pool.map(window, places))


def _begins(drive: Drive, length_s: float) -> list[int]:
    lead, length = drive.periods(LEAD_S), drive.periods(length_s)
    speed_mps = drive.smooth[:, 0]
    if speed_mps.max() > FASTEST_START_MPS:
        return []
    return [
        begin
        for begin in range(lead, len(speed_mps) - length, length)
        if speed_mps[begin - lead : begin + length].min() >= _LEAST_SPEED_MPS
    ]


def _follow(
    state: Array, car: Parameters, record: Array, drive: Drive, begin: int, end: int
) -> None:
    """Drive to row `end` with the motion set to the measured one at each row, in place."""
    motion = np.empty((drive.steps_per_period, 3))
    spin = slice(AT.spin_radps, AT.spin_radps + N_WHEELS)
    for row in range(begin, end + 1):
        speed_mps, vy_mps, yaw_rate_radps = drive.smooth[row]
        # The wheels turn faster by as much, so their slips remain.
        state[spin] += (speed_mps - state[AT.vx_mps]) / car.tyre.rolling_radius_m
        state[AT.vx_mps], state[AT.yaw_rate_radps] = speed_mps, yaw_rate_radps
        if isfinite(vy_mps):
            state[AT.vy_mps] = vy_mps
        if row < end:
            control = ControlInput(*drive.inputs[row].tolist())
            advance(state, control, record, len(motion), drive.step_s, motion)


def simulated(car: Parameters, window: Window) -> Array:
    """(end - begin, 3) motion of the car, as `SIGNALS`."""
    drive, state = window.drive, window.state.copy()
    lead = drive.periods(LEAD_S)
    _follow(state, car, car_record(car), drive, window.begin - lead, window.begin)
    inputs = drive.inputs[window.begin : window.end - 1]
    motion, _ = simulate(state, inputs, car, drive.steps_per_period, drive.step_s)
    return motion[:: drive.steps_per_period]


def errors_of(pool: ThreadPoolExecutor, car: Parameters, windows: Sequence[Window]) -> list[Array]:
    """(n, 3) simulated less measured, for each window; a car that has spun off is far away."""

    def error(window: Window) -> Array:
        measured = window.drive.measured[window.begin : window.end]
        found = np.nan_to_num(simulated(car, window), nan=1e2) - measured
        return np.clip(np.nan_to_num(found), -1e2, 1e2)

    return list(pool.map(error, windows))


def fit_car(
    base: Parameters,
    parameters: Sequence[Fitted],
    drives: Sequence[Drive],
    most_windows: int,
    on_progress: Callable[[str], None] = lambda text: None,
) -> CarFit:
    """The car of the drives, by least squares over at most `most_windows` windows.

    Raises:
        DatasetError: there are too few windows.
    """
    windows = windows_of(base, drives, FIT_S, most_windows)
    if len(windows) < LEAST_WINDOWS:
        raise DatasetError(
            f"expected at least {LEAST_WINDOWS} windows of {FIT_S:g} s in which the car is faster "
            f"than {_LEAST_SPEED_MPS:g} m/s, found {len(windows)}. Record longer drives."
        )
    is_told = np.ones(len(parameters), dtype=bool)
    with ThreadPoolExecutor() as pool:
        problem = _Problem(base, tuple(parameters), windows, pool, on_progress)
        # Most of the way with few windows, which is faster.
        few = _Problem(
            base, tuple(parameters), windows[:: -(-len(windows) // _FEW)], pool, on_progress
        )
        coarse = few.solve(np.zeros(len(parameters)), is_told, _FIRST_SCALES)
        coarse = few.solve(coarse.at, is_told, coarse.scales)
        solution = problem.solve(coarse.at, is_told, coarse.scales, 12)
        # A wide interval without the base car's value in it says that this value is wrong.
        while True:
            intervals = _intervals(solution, len(windows), is_told)
            widths, offsets = intervals.half_widths, np.abs(solution.at[is_told])
            is_open = (widths > LARGEST_HALF_WIDTH) & (offsets < widths)
            if not is_open.any():
                break
            is_told[np.flatnonzero(is_told)[np.argmax(np.where(is_open, widths, 0.0))]] = False
        if not is_told.all():
            solution = solution._replace(at=np.where(is_told, solution.at, 0.0))
        if is_told.any() and not is_told.all():
            solution = problem.solve(solution.at, is_told, solution.scales, 4)
            intervals = _intervals(solution, len(windows), np.ones(is_told.sum(), dtype=bool))
    half_widths = np.full(len(parameters), nan)
    half_widths[is_told] = intervals.half_widths
    car = car_with(base, parameters, solution.at)
    bounds = [each.bounds(base) for each in parameters]
    estimates = tuple(
        Estimate(each, float(at), float(half), not low + _STEP < at < high - _STEP)
        for each, at, half, (low, high) in zip(
            parameters, solution.at, half_widths, bounds, strict=True
        )
    )
    return CarFit(car, estimates, intervals.covariance, intervals.quantile, len(windows))


def half_width_of(fit: CarFit, base: Parameters, of: Callable[[Parameters], Array]) -> Array:
    """Half widths of the 95 % intervals of numbers (k,) that follow from the fitted car."""
    parameters = [each.parameter for each in fit.estimates]
    at = np.array([each.coordinate for each in fit.estimates])
    told = [k for k, each in enumerate(fit.estimates) if each.is_told]
    steps = _STEP * np.eye(len(at))[told]
    center = of(fit.car)
    slopes = np.array([of(car_with(base, parameters, at + step)) - center for step in steps])
    slopes /= _STEP
    variances: Array = np.einsum("ik,ij,jk->k", slopes, fit.covariance, slopes)
    return fit.quantile * np.sqrt(variances)


class _Solution(NamedTuple):
    at: Array
    """(p,) coordinates of all parameters"""
    scales: Array
    """(3,) RMS errors"""
    jacobian: Array
    """(r, m) of the m fitted ones; the last m rows are those of the prior"""
    residuals: Array
    """(r,) each error over its RMS"""


class _Intervals(NamedTuple):
    covariance: Array
    """(m, m) of the coordinates"""
    quantile: float
    half_widths: Array
    """(m,) of the 95 % intervals"""


def _intervals(solution: _Solution, windows: int, is_free: NDArray[np.bool_]) -> _Intervals:
    """Of the m free ones of the fitted coordinates; the others count as known."""
    priors = solution.jacobian.shape[1]
    J = solution.jacobian[:-priors, is_free]
    m = J.shape[1]
    prior, information = np.eye(m) / _PRIOR**2, J.T @ J
    residuals = solution.residuals[:-priors].reshape(windows, -1)
    windows_J = J.reshape(*residuals.shape, m)
    scores = np.einsum("wrm,wr->wm", windows_J, residuals)
    inverse = np.linalg.inv(information + prior)
    # Each window's score at the solution without that window, which is the jackknife.
    grams = np.einsum("wrm,wrn->wmn", windows_J, windows_J)
    scores = np.linalg.solve(np.eye(m) - grams @ inverse, scores[..., None])[..., 0]
    spread = scores.T @ scores * (windows - 1.0) / windows
    covariance = inverse @ (spread + prior) @ inverse
    quantile = float(student_t.ppf(0.975, windows - 1))
    return _Intervals(covariance, quantile, quantile * np.sqrt(np.diag(covariance)))


class _Problem:
    """Residuals of all windows as a function of the coordinates."""

    def __init__(
        self,
        base: Parameters,
        parameters: Sequence[Fitted],
        windows: Sequence[Window],
        pool: ThreadPoolExecutor,
        on_progress: Callable[[str], None],
    ) -> None:
        self._base, self._parameters, self._windows = base, parameters, windows
        self._pool, self._on_progress = pool, on_progress
        self._bounds = np.array([each.bounds(base) for each in parameters])

    def errors(self, at: Array) -> Array:
        """(W, n, 3) errors of the car with these coordinates."""
        car = car_with(self._base, self._parameters, at)
        return np.array(errors_of(self._pool, car, self._windows))

    def solve(
        self, start: Array, is_fitted: NDArray[np.bool_], scales: Array, iterations: int = 6
    ) -> _Solution:
        """Minimum over the fitted coordinates; the others stay at the start."""
        columns = np.flatnonzero(is_fitted)
        prior = np.eye(len(columns)) / _PRIOR
        low, high = self._bounds[columns].T

        def whole(x: Array) -> Array:
            at = start.copy()
            at[columns] = x
            return at

        def residuals(x: Array) -> Array:
            errors = self.errors(whole(x)) / scales
            rms = np.sqrt(np.mean(np.square(errors)))
            self._on_progress(f"fitting {len(columns)} parameters, error {rms:.3f}")
            return np.concatenate([errors.ravel(), prior @ x])

        def jacobian(x: Array) -> Array:
            center = residuals(x)
            steps = np.where(x + _STEP < high, _STEP, -_STEP)
            moved = [residuals(x + step) - center for step in np.diag(steps)]
            return np.transpose(moved) / steps

        inside = np.clip(start[columns], low + _STEP, high - _STEP)
        found = least_squares(
            residuals, inside, jacobian, (low, high), ftol=1e-4, xtol=1e-4, max_nfev=iterations
        )
        rms = np.sqrt(np.mean(np.square(self.errors(whole(found.x))), axis=(0, 1)))
        return _Solution(whole(found.x), np.where(rms > 0.0, rms, 1.0), found.jac, found.fun)


def judge(car: Parameters, drives: Sequence[Drive]) -> Judgement:
    """Errors of the car on these drives.

    Raises:
        DatasetError: they have no window.
    """
    windows = windows_of(car, drives, JUDGE_S)
    if not windows:
        raise DatasetError(
            f"expected a held-out drive of {JUDGE_S:g} s in which the car is faster than "
            f"{_LEAST_SPEED_MPS:g} m/s, found none. Name others in [split] of the mapping."
        )
    with ThreadPoolExecutor() as pool:
        errors = np.array(errors_of(pool, car, windows))
    measured = np.array([window.drive.measured[window.begin : window.end] for window in windows])
    wrong, size = (np.sqrt(np.mean(np.square(each), axis=(0, 1))) for each in (errors, measured))
    speed, lateral, yaw_rate = (100.0 * wrong / (np.ptp(measured[..., 0]), *size[1:])).tolist()
    return Judgement(
        yaw_rate,
        lateral,
        speed,
        JUDGE_S * len(windows),
    )
