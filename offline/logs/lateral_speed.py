"""Lateral speed of recorded drives that do not measure it, by a smoother over each stretch.

    v_y = v_rear + d,   d'' = -2 lambda d' - lambda^2 d + white noise

v_rear is the equation of the rear axle (`rt_controller.mapping.lateral_speed`) with constants that
are fitted to all logs; d is what the equation lacks, a Gauss-Markov process of second order. Three
ways, by what the logs have:

- pose: position and heading, dead-reckoned with speed, yaw rate and v_y, measure d;
- lateral acceleration: a_y = dv_y/dt + v_x r measures the slope of d;
- yaw rate: nothing measures d; the constants follow from the yaw response to the steering, or are
  those of [car].

Kalman filter forwards, Rauch-Tung-Striebel smoother backwards. The variances of the measurements
and of d are those of maximum likelihood, by expectation maximisation (Shumway and Stoffer, 1982).
"""

from collections.abc import Callable
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.optimize import least_squares
from scipy.signal import lfilter

from offline.logs.pieces import Pieces
from offline.logs.smoother import Gaussian, StateSpace, smooth
from rt_controller.contract.arrays import Array
from rt_controller.mapping.lateral_speed import SLOWEST_MPS, RearAxle

STANDING_MPS = 0.3
"""a slower car has no lateral speed"""
DECAY_PER_S = 3.0
"""lambda"""
ROLLING_MPS = 0.02
"""standard deviation of d of a car too slow for slip"""
SPEED_NOISE, DRIFT_NOISE, BANK_NOISE = 0.1, 0.005, 0.05
"""per square root of a second: of the position along and across the car in m, and of the bias of
lateral acceleration by the bank of the road in m/s^2"""
FITTED_EVERY = 4
"""constants are fitted to one of so many samples"""
SATURATED = 0.2
"""share of tau within which it varies with the lateral acceleration"""
ROUNDS = 3
"""of expectation maximisation"""


class Way(StrEnum):
    """What the lateral speed is estimated from."""

    POSE = "pose"
    ACCELERATION = "lateral acceleration"
    STEERING = "yaw rate and steering"
    YAW_RATE = "yaw rate"


class SmoothedSpeed(NamedTuple):
    """Lateral speed of motions, and the constants of their car."""

    way: Way
    axle: RearAxle
    vy_mps: list[Array]
    """(T,) of each motion"""
    std_mps: list[Array]
    """(T,) standard deviation"""
    yaw_rad: list[Array]
    """(T,) heading; empty without a pose"""


def _fit(
    errors: Callable[[Array], Array], prior: Array, scales: Array, pieces: Pieces
) -> tuple[Array, Array]:
    """Constants with the least errors (B, T), and their covariance.

    Errors of a car are not white: as many count as independent as there are seconds.
    """
    thin = slice(None, None, FITTED_EVERY)
    seconds = float(np.count_nonzero(pieces.is_fitted)) * pieces.period_s
    share = (seconds / max(1, int(np.count_nonzero(pieces.is_fitted[:, thin])))) ** 0.5
    found, lowest = np.array(prior), np.minimum(1e-4, 0.1 * prior)
    for _ in range(2):
        mean_square = float(np.sum(errors(found) ** 2)) / max(
            1, int(np.count_nonzero(pieces.is_fitted))
        )
        size = float(np.maximum(mean_square**0.5, 1e-4))

        def residuals(constants: Array, scale: float = share / size) -> Array:
            scaled = scale * errors(constants)[:, thin].ravel()
            return np.concatenate([scaled, (constants - prior) / scales])

        fit = least_squares(
            residuals, found, x_scale=scales, bounds=(lowest, np.inf), max_nfev=8, ftol=1e-4
        )
        found = fit.x
    return found, np.linalg.inv(fit.jac.T @ fit.jac)


def _most_likely(model: StateSpace, place: int, size_mps: float, pieces: Pieces) -> Gaussian:
    """The state with the variances of largest likelihood; d and its slope begin at `place`."""
    a, dt, d = DECAY_PER_S, pieces.period_s, slice(place, place + 2)
    move = np.exp(-a * dt) * np.array([[1.0 + a * dt, dt], [-(a**2) * dt, 1.0 - a * dt]])
    unit = np.diag([1.0, a**2])
    model.transition[..., d, d] = move
    known, variance = np.isfinite(model.measured), model.variance.copy()
    counts = np.maximum(np.sum(known, axis=(1, 2)), 1)
    for _ in range(ROUNDS):
        model.noise[..., d, d] = size_mps**2 * (unit - move @ unit @ move.T)
        model.start.covariance[..., d, d] = size_mps**2 * unit
        found = smooth(model._replace(variance=variance))
        expected = np.einsum("mi,tbi->mtb", model.rows, found.mean)
        error = np.where(known, model.measured - expected, 0.0)
        own = np.einsum("mi,tbij,mj->mtb", model.rows, found.covariance, model.rows)
        square = np.sum(np.where(known, error**2 + own, 0.0), axis=(1, 2)) / counts
        is_free = model.is_free & np.any(known, axis=(1, 2))
        variance = np.where(is_free, square, variance)
        second = found.mean[..., place] ** 2 + found.covariance[..., place, place]
        if pieces.is_fitted.any():
            size_mps = float(np.mean(second[pieces.is_fitted.T])) ** 0.5
    return found


def _white_noise(values: Array, is_own: NDArray[np.bool_]) -> float:
    """Standard deviation of white noise on smooth signals (B, T), from their third differences.

    At least 1e-4, and 1 of a signal that is not measured.
    """
    third = np.abs(np.diff(values, 3, axis=1)[is_own[:, 3:]])
    if not np.isfinite(third).any():
        return 1.0
    return max(float(np.median(third) / 0.6745 / 20.0**0.5), 1e-4)


def _mid(values: Array) -> Array:
    """(T-1, B) between the samples (B, T)."""
    return np.asarray(0.5 * (values[:, 1:] + values[:, :-1]).T)


def _rolling(pieces: Pieces) -> Array:
    """(T, B) d of a car too slow for slip; NaN: not known."""
    return np.where(pieces.vx < SLOWEST_MPS, 0.0, np.nan).T


def by_pose(
    pieces: Pieces, pose: Array, prior: RearAxle, scales: Array, every: int
) -> SmoothedSpeed:
    """From poses (B, T, 3) that are sampled about every so many periods."""
    measured = np.where(pieces.is_own[..., None], pose, np.nan)
    measured[:, np.arange(pose.shape[1]) % every != 0] = np.nan
    has_yaw, yaw = bool(np.isfinite(pose[..., 2]).any()), pose[..., 2]
    if not has_yaw:
        yaw = _course(pieces, pose)
    none = RearAxle(0.0, 0.0, 0.0)
    free = _pose_model(pieces, measured, yaw, none, 0.0 * yaw, every)
    state = _most_likely(free, 3, 0.3, pieces)
    vy = state.mean[..., 3].T
    aslant = pieces.vx if has_yaw else 0.0 * pieces.vx

    def errors(constants: Array) -> Array:
        return pieces.without(vy - pieces.rear(RearAxle(*constants)), aslant)[0]

    constants, _ = _fit(errors, np.array(prior), scales, pieces)
    axle = RearAxle(*map(float, constants))
    rear = pieces.rear(axle)
    # The axis of the heading is not exactly that of the car: their angle is a v_y over speed.
    _, angle = pieces.without(vy - rear, aslant)
    measured[..., 2] += angle[:, None]
    model = _pose_model(pieces, measured, yaw + angle[:, None], axle, rear, every)
    state = _most_likely(model, 3, 0.05, pieces)
    lever = axle.rear_axle_m - axle.slip_s2_per_m * pieces.vx**2
    row = np.zeros_like(state.mean)
    row[..., 3], row[..., 5] = 1.0, -lever.T
    vy = rear + np.einsum("tbi,tbi->tb", row, state.mean).T
    std = np.einsum("tbi,tbij,tbj->tb", row, state.covariance, row).T ** 0.5
    return _smoothed(pieces, Way.POSE, axle, vy, std, state.mean[..., 2].T)


def _smoothed(
    pieces: Pieces, way: Way, axle: RearAxle, vy: Array, std: Array, yaw: Array | None = None
) -> SmoothedSpeed:
    is_moving = pieces.vx >= STANDING_MPS
    vys, stds = (pieces.join(np.where(is_moving, each, 0.0)) for each in (vy, std))
    return SmoothedSpeed(way, axle, vys, stds, [] if yaw is None else pieces.join(yaw))


def _course(pieces: Pieces, pose: Array) -> Array:
    """(B, T) heading of a car that drives where it points, over about half a second."""
    half = round(0.25 / pieces.period_s)
    index = np.arange(pose.shape[1])
    last = np.sum(pieces.is_own, axis=1)[:, None] - 1
    ahead = np.minimum(index + half, last)[..., None]
    behind = np.maximum(np.minimum(index - half, last - half), 0)[..., None]
    way = np.take_along_axis(pose, ahead, 1) - np.take_along_axis(pose, behind, 1)
    return np.asarray(np.unwrap(np.arctan2(way[..., 1], way[..., 0])))


def _pose_model(
    pieces: Pieces, measured: Array, yaw: Array, axle: RearAxle, rear: Array, every: int
) -> StateSpace:
    """States x, y, heading, d, slope of d, bias of the yaw rate; linear about the yaw (B, T)."""
    dt, (n, steps) = pieces.period_s, pieces.vx.shape
    cos, sin = np.cos(_mid(yaw)), np.sin(_mid(yaw))
    vx, vy, rate = _mid(pieces.vx), _mid(rear), _mid(pieces.yaw_rate)
    lever = axle.rear_axle_m - axle.slip_s2_per_m * vx**2
    transition = np.tile(np.eye(6), (steps - 1, n, 1, 1))
    drift, noise = np.zeros((steps - 1, n, 6)), np.zeros((steps - 1, n, 6, 6))
    for i, (ahead, left) in enumerate(((cos, -sin), (sin, cos))):
        turned = left * vx - ahead * vy
        transition[..., i, 2] = dt * turned
        transition[..., i, 3] = dt * left
        transition[..., i, 4] = 0.5 * dt**2 * left
        transition[..., i, 5] = -dt * left * lever
        drift[..., i] = dt * (ahead * vx + left * vy + turned * (0.5 * dt * rate - _mid(yaw)))
    transition[..., 2, 5], drift[..., 2] = -dt, dt * rate
    along, across = dt * SPEED_NOISE**2, dt * DRIFT_NOISE**2
    noise[..., 0, 0] = cos**2 * along + sin**2 * across
    noise[..., 1, 1] = sin**2 * along + cos**2 * across
    noise[..., 0, 1] = noise[..., 1, 0] = cos * sin * (along - across)
    gyro = _white_noise(pieces.yaw_rate, pieces.is_own)
    noise[..., 2, 2], noise[..., 5, 5] = (gyro * dt) ** 2, 1e-10 * dt
    first = measured[:, 0].copy()
    measured = measured - first[:, None] * [1.0, 1.0, 0.0]
    start = np.zeros((n, 6))
    start[:, 2] = yaw[:, 0]
    square = np.tile(np.diag([1.0, 1.0, 0.05, 0.0, 0.0, 1e-4]), (n, 1, 1))
    thin = measured[:, ::every], pieces.is_own[:, ::every]
    sizes = [_white_noise(thin[0][..., i], thin[1]) for i in range(3)]
    return StateSpace(
        transition,
        drift,
        noise,
        np.eye(4, 6),
        np.concatenate([measured.transpose(2, 1, 0), _rolling(pieces)[None]]),
        np.array([*sizes, ROLLING_MPS]) ** 2,
        np.array([True, True, True, False]),
        Gaussian(start, square),
    )


def by_acceleration(pieces: Pieces, ay: Array, prior: RearAxle, scales: Array) -> SmoothedSpeed:
    """From an accelerometer, its scale and offset unknown: a car that rolls tilts it."""
    one, period_s = np.ones_like(ay), pieces.period_s
    centripetal = pieces.vx * pieces.yaw_rate

    def turning(constants: Array) -> Array:
        slope = np.gradient(pieces.rear(RearAxle(*constants[:3])), period_s, axis=1)
        return _mean5(slope + centripetal)

    smooth_ay = _mean5(ay)

    def errors(constants: Array) -> Array:
        return pieces.without(smooth_ay / constants[3] - turning(constants), one)[0]

    start = np.array([*prior, 1.0])
    constants, cov = _fit(errors, start, np.array([*scales, 0.1]), pieces)
    axle, scale = RearAxle(*map(float, constants[:3])), float(constants[3])
    rear = pieces.rear(axle)
    _, bias = pieces.without(smooth_ay / scale - turning(constants), one)
    left = ay / scale - bias[:, None] - np.gradient(rear, period_s, axis=1) - centripetal
    n, steps = ay.shape
    model = StateSpace(
        np.tile(np.eye(3), (steps - 1, n, 1, 1)),
        np.zeros((steps - 1, n, 3)),
        np.tile(np.diag([0.0, 0.0, BANK_NOISE**2 * period_s]), (steps - 1, n, 1, 1)),
        np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 0.0]]),
        np.stack([np.where(pieces.is_own, left, np.nan).T, _rolling(pieces)]),
        np.array([max(_white_noise(left, pieces.is_own), 1e-3), ROLLING_MPS]) ** 2,
        np.array([True, False]),
        Gaussian(np.zeros((n, 3)), np.tile(np.diag([0.0, 0.0, 0.04]), (n, 1, 1))),
    )
    state = _most_likely(model, 0, 0.03, pieces)
    variance = state.covariance[..., 0, 0].T + _spread(pieces, axle, cov)
    return _smoothed(pieces, Way.ACCELERATION, axle, rear + state.mean[..., 0].T, variance**0.5)


def _mean5(values: Array) -> Array:
    """Mean (B, T) of five neighbours."""
    return np.asarray(uniform_filter1d(values, 5, axis=1, mode="nearest"))


def _spread(pieces: Pieces, axle: RearAxle, cov: Array) -> Array:
    """Variance (B, T) of v_y by the covariance of the constants."""
    steps = 0.1 * np.diag(cov)[:3] ** 0.5
    slopes = []
    for i, step in enumerate(steps):
        ends = np.array(axle) + np.eye(3)[i] * step
        slopes.append((pieces.rear(RearAxle(*ends)) - pieces.rear(axle)) / max(step, 1e-12))
    return np.asarray(np.einsum("ibt,ij,jbt->bt", slopes, cov[:3, :3], slopes))


def by_yaw_rate(
    pieces: Pieces, wheel: Array | None, prior: RearAxle, scales: Array, wheelbase_m: float
) -> SmoothedSpeed:
    """From the equation alone; its constants by the response to the steering, if that is known."""
    if wheel is None:
        way, axle, cov = Way.YAW_RATE, prior, np.diag(scales**2)
    else:

        def errors(constants: Array) -> Array:
            found = _yaw_response(constants, pieces, wheel, wheelbase_m)
            cause = pieces.vx / (wheelbase_m + 0.005 * pieces.vx**2)
            return pieces.without(found - pieces.yaw_rate, cause)[0]

        start = np.array([*prior, prior.slip_s2_per_m + 0.003, 1.0, 0.03])
        # b keeps its value: tyres that saturate would move it further than it is unknown.
        own = np.array([0.01 * scales[0], *scales[1:], 3e-3, 0.3, 0.03])
        constants, cov = _fit(errors, start, own, pieces)
        way, axle = Way.STEERING, RearAxle(*map(float, constants[:3]))
        cov = cov[:3, :3] + np.diag([scales[0], SATURATED * axle.slip_s2_per_m, 0.0]) ** 2
    return _smoothed(pieces, way, axle, pieces.rear(axle), _spread(pieces, axle, cov) ** 0.5)


def _yaw_response(constants: Array, pieces: Pieces, wheel: Array, wheelbase_m: float) -> Array:
    """Yaw rate (B, T) of a single-track car to its wheels (B, T), by the trapezoidal rule.

    The equation of the rear axle, and that of the front one with a slip angle per lateral
    acceleration of its own, a factor of the wheel angle, and a lag of first order.
    """
    b, tau, q, front, gain, lag_s = constants
    dt, vx = pieces.period_s, np.maximum(pieces.vx, SLOWEST_MPS)
    kept = np.exp(-dt / lag_s)
    angle = gain * lfilter([1.0 - kept], [1.0, -kept], wheel, axis=1, zi=kept * wheel[:, :1])[0]
    k = b / (q * wheelbase_m)
    a21 = k / vx * (1.0 / tau - 1.0 / front)
    a22 = -k / vx * ((wheelbase_m - b) / front + b / tau)
    a11, a12 = q * a21 - 1.0 / (vx * tau), q * a22 + b / (vx * tau) - vx
    inputs = k / front * angle
    vy, rate = pieces.rear(RearAxle(b, tau, q))[:, 0], pieces.yaw_rate[:, 0]
    found = np.empty_like(vx)
    found[:, 0] = rate
    h = 0.5 * dt
    det = (1.0 - h * a11) * (1.0 - h * a22) - h * h * a12 * a21
    for t in range(vx.shape[1] - 1):
        p = vy + h * (a11[:, t] * vy + a12[:, t] * rate + q * (inputs[:, t] + inputs[:, t + 1]))
        s = rate + h * (a21[:, t] * vy + a22[:, t] * rate + inputs[:, t] + inputs[:, t + 1])
        n = t + 1
        vy, rate = (
            ((1.0 - h * a22[:, n]) * p + h * a12[:, n] * s) / det[:, n],
            (h * a21[:, n] * p + (1.0 - h * a11[:, n]) * s) / det[:, n],
        )
        found[:, n] = rate
    return found
