"""A quadratic program in memory that does not move: one side writes it, the other solves it."""

from dataclasses import dataclass, field
from math import isfinite, isnan

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.bundle import Array


@dataclass(frozen=True, slots=True)
class QuadraticProgram:
    """minimise 1/2 z' P z + q' z subject to lower <= z <= upper, row_lower <= G z <= row_upper.

    Bounds may be infinite. P is symmetric and positive definite. Vectors change at every solve,
    matrices only where the program says so, and then their readers are told (`Solver.renew`).
    """

    P: Array
    """(n, n)"""
    q: Array
    """(n,)"""
    G: Array
    """(r, n)"""
    pattern: NDArray[np.bool_]
    """(r, n), where G may ever hold something else than zero"""
    renews_hessian: bool
    """whether P may change"""
    renews_rows: bool
    """whether G may"""
    bounds: Array = field(init=False)
    """(2, n + r): lower ones, then upper ones, of the variables and then of the rows"""

    def __post_init__(self) -> None:
        bounds = np.empty((2, sum(self.G.shape)))
        bounds[0], bounds[1] = -np.inf, np.inf
        object.__setattr__(self, "bounds", bounds)

    @property
    def renews(self) -> bool:
        """Whether any matrix may change."""
        return self.renews_hessian or self.renews_rows

    def has_finite_vectors(self) -> bool:
        """Whether q is of numbers and no bound is none; bounds may be infinite."""
        # One sum or minimum of everything costs less than one test for each.
        return isfinite(self.q.dot(self.q)) and not isnan(self.bounds.min())

    def has_finite_matrices(self) -> bool:
        """Whether those that change are of numbers."""
        return not (self.renews_hessian and not np.isfinite(self.P.sum())) and not (
            self.renews_rows and not np.isfinite(self.G.sum())
        )

    @property
    def size(self) -> int:
        """n, variables."""
        return self.q.size

    @property
    def every_lower(self) -> Array:
        """(n + r,), a view"""
        view: Array = self.bounds[0]
        return view

    @property
    def every_upper(self) -> Array:
        """(n + r,), a view"""
        view: Array = self.bounds[1]
        return view

    @property
    def lower(self) -> Array:
        """(n,), a view"""
        return self.bounds[0, : self.size]

    @property
    def upper(self) -> Array:
        """(n,), a view"""
        return self.bounds[1, : self.size]

    @property
    def row_lower(self) -> Array:
        """(r,), a view"""
        return self.bounds[0, self.size :]

    @property
    def row_upper(self) -> Array:
        """(r,), a view"""
        return self.bounds[1, self.size :]
