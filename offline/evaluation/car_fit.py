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
from offline.data.manifest import Imported, Part
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
class MeasuredDrive:
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

    drive: MeasuredDrive
    begin: int
    """row of the first compared sample"""
    end: int
    """row after the last one"""
    state: Array
    """(N_STATES,) `LEAD_S` before the begin"""


class FittedValue(NamedTuple):
    """A number of the car before and after the fit."""

    base: float
    value: float
    low: float
    """of the 95 % interval; NaN if the drives do not tell the number"""
    high: float
    remark: str


class CarFit(NamedTuple):
    """The fitted car, its numbers by name, and how many windows told them."""

    car: Parameters
    values: dict[str, FittedValue]
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


def drives_of(dataset: Dataset, parts: Sequence[Part]) -> list[MeasuredDrive]:
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
    origin = dataset.origin
    std_mps = (origin.lateral_speed_std_mps if isinstance(origin, Imported) else None) or 0.0
    is_compared = lateral in schema.state_names and std_mps <= LARGEST_STD_MPS
    names = (speed, lateral if is_compared else speed, yaw_rate)
    columns = [schema.input_names.index(name) for name in inputs]
    states = [schema.state_names.index(name) for name in names]
    size = 2 * round(0.5 * _SMOOTHING_S / schema.dt_s) + 1
    drives = []
    for part in parts:
        for episode in dataset.episodes(part):
            first = int(recording.first[episode])
            rows = slice(first, first + int(recording.lengths[episode]))
            measured = recording.x[rows][:, states].astype(float)
            if len(measured) < size:
                continue
            smooth = savgol_filter(measured, size, 3, axis=0) if size > 4 else measured.copy()
            if not is_compared:
                measured[:, 1] = smooth[:, 1] = nan
            drives.append(
                MeasuredDrive(
                    recording.u[rows][:, columns].astype(float), measured, smooth, schema.dt_s
                )
            )
    return drives


def windows_of(
    car: Parameters, drives: Iterable[MeasuredDrive], length_s: float, most: int | None = None
) -> list[Window]:
    """Windows that follow each other, in which the car is faster than 3 m/s.

    The state before each is that of `car`, which follows the drive for 4 s. `most` are spread over
    all that there are.
    """
    places = [(drive, begin) for drive in drives for begin in _begins(drive, length_s)]
    if most is not None and len(places) > most:
        places = [places[k] for k in np.linspace(0, len(places) - 1, most).round().astype(int)]

    def window(place: tuple[MeasuredDrive, int]) -> Window:
        drive, begin = place
        until = begin - drive.periods(LEAD_S)
        since = max(0, until - drive.periods(_HISTORY_S))
        state = settle(max(0.0, float(drive.smooth[since, 0])), car)
        _follow(state, car, car_record(car), drive, since, until)
        return Window(drive, begin, begin + drive.periods(length_s), state)

    with ThreadPoolExecutor() as pool:
        return list(pool.map(window, places))


def _begins(drive: MeasuredDrive, length_s: float) -> list[int]:
    lead, length = drive.periods(LEAD_S), drive.periods(length_s)
    since, speed_mps = lead + drive.periods(_HISTORY_S), drive.smooth[:, 0]
    return [
        begin
        for begin in range(lead, len(speed_mps) - length, length)
        if speed_mps[begin - lead : begin + length].min() >= _LEAST_SPEED_MPS
        and speed_mps[max(0, begin - since) : begin + length].max() <= FASTEST_START_MPS
    ]


def _follow(
    state: Array, car: Parameters, record: Array, drive: MeasuredDrive, begin: int, end: int
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


def errors_of(car: Parameters, windows: Sequence[Window]) -> Array:
    """(W, n, 3) simulated less measured; a car that has spun off is far away."""

    def error(window: Window) -> Array:
        measured = window.drive.measured[window.begin : window.end]
        found = np.nan_to_num(simulated(car, window), nan=1e2) - measured
        return np.clip(np.nan_to_num(found), -1e2, 1e2)

    with ThreadPoolExecutor() as pool:
        return np.array(list(pool.map(error, windows)))


def fit_car(
    base: Parameters,
    parameters: Sequence[Fitted],
    drives: Sequence[MeasuredDrive],
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
    problem = _Problem(base, parameters, windows, on_progress)
    # Most of the way with few windows, which is faster.
    few = _Problem(base, parameters, windows[:: ceil(len(windows) / _FEW)], on_progress)
    coarse = few.solve(np.zeros(len(parameters)), is_told, _FIRST_SCALES)
    coarse = few.solve(coarse.at, is_told, coarse.scales)
    solution = problem.solve(coarse.at, is_told, coarse.scales, 12)
    half_widths = _half_widths(solution, len(windows), is_told)
    # A wide interval without the base car's value in it says that this value is wrong.
    while np.any(
        is_open := (half_widths > LARGEST_HALF_WIDTH) & (np.abs(solution.at) < half_widths)
    ):
        is_told[np.argmax(np.where(is_open, half_widths, 0.0))] = False
        half_widths = _half_widths(solution, len(windows), is_told)
    solution = solution._replace(at=np.where(is_told, solution.at, 0.0))
    if is_told.any() and not is_told.all():
        solution = problem.solve(solution.at, is_told, solution.scales, 4)
        half_widths = _half_widths(solution, len(windows), is_told)
    found = zip(parameters, solution.at, half_widths, strict=True)
    values = {each.name: _value(base, each, float(at), float(half)) for each, at, half in found}
    return CarFit(car_with(base, parameters, solution.at), values, len(windows))


def _value(base: Parameters, parameter: Fitted, at: float, half_width: float) -> FittedValue:
    """Of a coordinate and the half width of its interval, which is NaN if it is not told."""
    lowest, highest = parameter.bounds(base)
    inside = np.clip((at, at - half_width, at + half_width), lowest, highest).tolist()
    remark = "" if lowest + _STEP < at < highest - _STEP else "at the bound"
    if not isfinite(half_width):
        remark = "not told"
    value, low, high = (parameter.value(base, each) for each in inside)
    return FittedValue(parameter.of(base), value, low, high, remark)


class _Solution(NamedTuple):
    at: Array
    """(p,) coordinates of all parameters"""
    scales: Array
    """(3,) RMS errors"""
    jacobian: Array
    """(r, p); 0 for parameters that are not fitted"""
    residuals: Array
    """(r,) each error over its RMS"""


def _half_widths(solution: _Solution, windows: int, is_free: NDArray[np.bool_]) -> Array:
    """(p,) of the 95 % intervals of the free coordinates; NaN for others, which count as known."""
    J, m = solution.jacobian[:, is_free], int(np.count_nonzero(is_free))
    prior, information = np.eye(m) / _PRIOR**2, J.T @ J
    residuals = solution.residuals.reshape(windows, -1)
    windows_J = J.reshape(*residuals.shape, m)
    scores = np.einsum("wrm,wr->wm", windows_J, residuals)
    inverse = np.linalg.inv(information + prior)
    # Each window's score at the solution without that window, which is the jackknife.
    grams = np.einsum("wrm,wrn->wmn", windows_J, windows_J)
    scores = np.linalg.solve(np.eye(m) - grams @ inverse, scores[..., None])[..., 0]
    spread = scores.T @ scores * (windows - 1.0) / windows
    covariance = inverse @ (spread + prior) @ inverse
    half_widths = np.full(len(is_free), nan)
    half_widths[is_free] = student_t.ppf(0.975, windows - 1) * np.sqrt(np.diag(covariance))
    return half_widths


@dataclass(frozen=True, slots=True)
class _Problem:
    """Least squares over all windows."""

    base: Parameters
    parameters: Sequence[Fitted]
    windows: Sequence[Window]
    on_progress: Callable[[str], None]

    def errors(self, at: Array) -> Array:
        """(W, n, 3) errors of the car with these coordinates."""
        return errors_of(car_with(self.base, self.parameters, at), self.windows)

    def solve(
        self, start: Array, is_fitted: NDArray[np.bool_], scales: Array, iterations: int = 6
    ) -> _Solution:
        """Minimum over the fitted coordinates; the others stay at the start."""
        columns = np.flatnonzero(is_fitted)
        prior = np.eye(len(columns)) / _PRIOR
        low, high = np.transpose([each.bounds(self.base) for each in self.parameters])[:, columns]

        def whole(x: Array) -> Array:
            at = start.copy()
            at[columns] = x
            return at

        def residuals(x: Array) -> Array:
            errors = self.errors(whole(x)) / scales
            rms = np.sqrt(np.mean(np.square(errors)))
            self.on_progress(f"fitting {len(columns)} parameters, error {rms:.3f}")
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
        at, known = whole(found.x), slice(0, -len(columns))  # without the rows of the prior
        rms = np.sqrt(np.mean(np.square(self.errors(at)), axis=(0, 1)))
        slopes = np.zeros((len(found.fun[known]), len(at)))
        slopes[:, columns] = found.jac[known]
        return _Solution(at, np.where(rms > 0.0, rms, 1.0), slopes, found.fun[known])


def judge(car: Parameters, drives: Sequence[MeasuredDrive]) -> Judgement:
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
    errors = errors_of(car, windows)
    measured = np.array([window.drive.measured[window.begin : window.end] for window in windows])
    wrong, size = (np.sqrt(np.mean(np.square(each), axis=(0, 1))) for each in (errors, measured))
    speed, lateral, yaw_rate = (100.0 * wrong / (np.ptp(measured[..., 0]), *size[1:])).tolist()
    return Judgement(yaw_rate, lateral, speed, JUDGE_S * len(windows))
