"""A quadratic program in memory that does not move: one side writes it, the other solves it."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.bundle import Array


@dataclass(frozen=True, slots=True)
class QuadraticProgram:
    """minimise 1/2 z' P z + q' z subject to lower <= z <= upper, row_lower <= G z <= row_upper.

    Bounds may be infinite. P is symmetric and positive definite.
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
    """whether P changes from tick to tick; vectors always do"""
    renews_rows: bool
    every_lower: Array = field(init=False)
    """(n + r,), of the variables and then of the rows"""
    every_upper: Array = field(init=False)

    def __post_init__(self) -> None:
        free = np.full(sum(self.G.shape), np.inf)
        object.__setattr__(self, "every_lower", -free)
        object.__setattr__(self, "every_upper", free)

    @property
    def is_finite(self) -> bool:
        """Whether all that changes from tick to tick is a number; bounds may be infinite."""
        return bool(
            np.isfinite(self.q).all()
            and not np.isnan(self.every_upper).any()
            and not np.isnan(self.every_lower).any()
            and not (self.renews_hessian and not np.isfinite(self.P).all())
            and not (self.renews_rows and not np.isfinite(self.G).all())
        )

    @property
    def size(self) -> int:
        """n, variables."""
        return self.q.size

    @property
    def lower(self) -> Array:
        """(n,), a view"""
        return self.every_lower[: self.size]

    @property
    def upper(self) -> Array:
        """(n,), a view"""
        return self.every_upper[: self.size]

    @property
    def row_lower(self) -> Array:
        """(r,), a view"""
        return self.every_lower[self.size :]

    @property
    def row_upper(self) -> Array:
        """(r,), a view"""
        return self.every_upper[self.size :]
