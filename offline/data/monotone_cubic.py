"""Interpolation of random points by a cubic that does not overshoot them."""

import numpy as np

from rt_controller.contract.arrays import Array


def monotone_cubic(knot_t: Array, knot_y: Array, t: Array) -> Array:
    """Values at t of the cubic Hermite spline through the knots that does not overshoot them.

    Slopes are weighted harmonic means of the neighbouring secants, zero where these change sign
    (Fritsch and Butland, 1984). Written out, because scipy rounds differently and the digests of
    the data sets that the shipped models were trained on depend on the last bit.
    """
    width = np.diff(knot_t)
    secant = np.diff(knot_y) / width
    left, right = secant[:-1], secant[1:]
    w_left, w_right = 2 * width[1:] + width[:-1], width[1:] + 2 * width[:-1]
    same_sign = left * right > 0
    safe_left, safe_right = np.where(same_sign, left, 1.0), np.where(same_sign, right, 1.0)
    harmonic = (w_left + w_right) / (w_left / safe_left + w_right / safe_right)
    inner = np.where(same_sign, harmonic, 0.0)
    slope = np.concatenate([secant[:1], inner, secant[-1:]])

    i = np.clip(np.searchsorted(knot_t, t, side="right") - 1, 0, len(width) - 1)
    h = width[i]
    s = (t - knot_t[i]) / h
    return np.asarray(
        (1 + 2 * s) * (1 - s) ** 2 * knot_y[i]
        + s * (1 - s) ** 2 * h * slope[i]
        + s**2 * (3 - 2 * s) * knot_y[i + 1]
        + s**2 * (s - 1) * h * slope[i + 1]
    )
