"""The functions of a fixed dictionary.

All are functions of one vector v, the scaled states and exogenous signals, with entries of size 1:

- monomials: products of entries of v (Williams, Kevrekidis and Rowley, 2015);
- Gaussians around centres that k-means finds in the data;
- cosines of random frequencies, which approximate a Gaussian kernel (Rahimi and Recht, 2007).
"""

from enum import StrEnum
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
import scipy.cluster.vq

from rt_controller.contract.arrays import Array

_KMEANS_ITERATIONS = 20
_KMEANS_SAMPLES = 20_000


class Family(StrEnum):
    """Kind of function."""

    NONE = "none"
    MONOMIALS = "monomials"
    GAUSSIANS = "gaussians"
    COSINES = "cosines"


class Functions(NamedTuple):
    """F functions of v (..., q)."""

    family: Family
    rows: Array
    """monomials: (F, degree) indices of the entries to multiply, q stands for a factor 1;
    otherwise (F, q) centres or frequencies"""
    shifts: Array
    """(F,) phases of cosines"""
    width: float
    """of Gaussians, or of the kernel that cosines approximate"""

    def evaluate(self, v: Array) -> Array:
        """Their values (..., F)."""
        if self.family is Family.MONOMIALS:
            factors = np.concatenate([v, np.ones((*v.shape[:-1], 1))], axis=-1)
            columns = self.rows.astype(np.int64)
            values = factors[..., columns[:, 0]]
            for column in columns.T[1:]:
                values = values * factors[..., column]
            return np.asarray(values)
        if self.family is Family.GAUSSIANS:
            square = np.square(v).sum(-1)[..., None] + np.square(self.rows).sum(-1)
            distance = np.maximum(square - 2.0 * (v @ self.rows.T), 0.0)
            return np.asarray(np.exp(-distance / (2.0 * self.width**2)))
        if self.family is Family.COSINES:
            return np.asarray(np.cos(v @ self.rows.T + self.shifts))
        return np.zeros((*v.shape[:-1], 0))


def no_functions(q: int) -> Functions:
    """An empty dictionary of v (..., q)."""
    return Functions(Family.NONE, np.zeros((0, q)), np.zeros(0), 1.0)


def monomials(q: int, degrees: range) -> Functions:
    """All monomials of these degrees of v (..., q), lowest degree first."""
    most = max(degrees)
    rows = [
        (*entries, *[q] * (most - degree))
        for degree in degrees
        for entries in combinations_with_replacement(range(q), degree)
    ]
    return Functions(Family.MONOMIALS, np.array(rows, dtype=np.float64), np.zeros(len(rows)), 1.0)


def gaussians(v: Array, count: int, width: float, seed: int) -> Functions:
    """Gaussians around the means of `count` clusters of v (M, q).

    `width` is in units of the median distance from a centre to its nearest neighbour.
    """
    every = -(-len(v) // _KMEANS_SAMPLES)
    centres, _ = scipy.cluster.vq.kmeans2(
        v[::every], count, iter=_KMEANS_ITERATIONS, minit="++", seed=np.random.default_rng(seed)
    )
    distance = np.sqrt(np.square(centres[:, None] - centres[None]).sum(-1))
    np.fill_diagonal(distance, np.inf)
    typical = float(np.median(distance.min(axis=1)))
    return Functions(Family.GAUSSIANS, centres, np.zeros(count), width * typical)


def cosines(q: int, count: int, length: float, seed: int) -> Functions:
    """Cosines with random phases, whose kernel is a Gaussian of width `length`."""
    rng = np.random.default_rng(seed)
    frequencies = rng.normal(size=(count, q)) / length
    return Functions(Family.COSINES, frequencies, rng.uniform(0.0, 2.0 * np.pi, count), length)
