"""Stretches of drives cut into pieces of equal length, for computing with all of them at once."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.mapping.lateral_speed import RearAxle, lateral_speed

PIECE_S, OVERLAP_S = 60.0, 5.0
"""longer stretches are smoothed in pieces, side by side; their ends are cut off"""
FITTED_MPS = 3.0
"""constants are fitted to faster samples"""


class MeasuredMotion(NamedTuple):
    """One stretch of a drive, (T,) each at the period of the data set."""

    log: int
    """number of its log"""
    vx_mps: Array
    yaw_rate: Array
    pose: Array | None
    """(T, 3) of the centre of gravity; the yaw is NaN if it is not measured"""
    ay_mps2: Array | None
    wheel_rad: Array | None
    """of the road wheels, with the steering ratio of the car"""


class Pieces(NamedTuple):
    """Motions cut into B pieces of at most a minute, (B, T) each; short ones repeat their end."""

    period_s: float
    spans: tuple[tuple[int, int, int], ...]
    """number of the motion, its first sample, and that after its last"""
    log: NDArray[np.int64]
    """(B,)"""
    is_own: NDArray[np.bool_]
    """False: repeated"""
    vx: Array
    yaw_rate: Array
    pose: Array | None
    """(B, T, 3)"""
    ay: Array | None
    wheel: Array | None

    def join(self, found: Array) -> list[Array]:
        """(T, ...) of each motion: each sample is of the piece whose end is farther away."""
        half, joined = round(0.5 * OVERLAP_S / self.period_s), defaultdict[int, list[Array]](list)
        for values, (i, a, b), after in zip(
            found, self.spans, (*self.spans[1:], (-1, 0, 0)), strict=True
        ):
            own = values[half if a else 0 : b - a]
            joined[i].append(own[: len(own) - half] if after[0] == i else own)
        return [np.concatenate(each) for each in joined.values()]

    def rear(self, axle: RearAxle) -> Array:
        """v_y of the equation, (B, T)."""
        return lateral_speed(axle, self.vx, self.yaw_rate, self.period_s)

    @property
    def is_fitted(self) -> NDArray[np.bool_]:
        """(B, T) true for samples that constants are fitted to."""
        return self.is_own & (self.vx > FITTED_MPS)

    def without(self, error: Array, cause: Array) -> tuple[Array, Array]:
        """The error (B, T) without what a constant times `cause` explains; one constant a log.

        The second result is that constant (B,).
        """
        same = self.log[:, None] == self.log
        product, square = (
            same @ np.sum(self.is_fitted * each, axis=1) for each in (error * cause, cause**2)
        )
        constant = product / np.maximum(square, 1e-9)
        return self.is_fitted * (error - constant[:, None] * cause), constant


def cut_pieces(motions: Sequence[MeasuredMotion], period_s: float) -> Pieces:
    """The motions in pieces that overlap."""
    whole, overlap = round(PIECE_S / period_s), round(OVERLAP_S / period_s)
    spans = tuple(
        (i, a, min(a + whole, len(motion.vx_mps)))
        for i, motion in enumerate(motions)
        for a in range(0, max(len(motion.vx_mps) - overlap, 1), whole - overlap)
    )
    lengths = np.array([b - a for _, a, b in spans])
    index = np.arange(lengths.max())

    def take(name: str) -> Any:
        arrays = [getattr(motion, name) for motion in motions]
        if arrays[0] is None:
            return None
        return np.array([arrays[i][np.minimum(a + index, b - 1)] for i, a, b in spans])

    log = np.array([motions[i].log for i, _, _ in spans])
    measured = map(take, MeasuredMotion._fields[1:])
    return Pieces(period_s, spans, log, index < lengths[:, None], *measured)
