"""The model along a plan: the predicted states, and their derivatives by the inputs."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.signals import N_INPUTS, PATH_STATES, StateColumn
from rt_controller.control.pedals import WITH_PEDAL
from rt_controller.control.terms import Knots
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Step
from rt_controller.model.follow import Follow
from rt_controller.model.path_kinematics import PathDerivatives, path_of

ALL_INPUTS = slice(None)


class Linearisation:
    """Predicted states under nominal inputs, and their exact derivatives, in preallocated memory.

    With the gains of `model.dynamics.Step`,

        psi+ = A psi + B_uc u + N (t m - a o) + B_uw kappa + c

    where m is what a gain is multiplied by (an input, the curvature, or 1). So the derivative of
    psi+ by psi is J = A + N W S with the diagonal matrix W = diag(m t' - o), and that by an input
    is its column of B_uc plus N t over its gains.
    One QP a period is one iteration of a sequential quadratic program.

    The derivatives of the tracked states are propagated backwards (adjoint equation), from the end
    of each interval between two knots to the present: a row y' becomes y' J. Where all knots lie on
    even stages, two stages are one product,

        J' J = (A + N W' S)(A + N W S) = A A + N W' S A + (A N + N W' S N) W S,

    of which only W and W' depend on the plan.

    Gains that follow the first state or the free response do not depend on the inputs: then J = A.
    Where the path follows from the motion by kinematics, its derivatives are further terms of the
    same form, N W S, with weights from the predicted path.

    Paper: eq. (14), with the bilinear model that its conclusion names.
    """

    def __init__(self, bundle: Bundle, knots: Knots, tracked: Sequence[int]) -> None:
        """`tracked`: columns of the states whose derivatives are needed."""
        n, m, stages = bundle.n_observables, N_INPUTS, knots.horizon
        self._bundle, self._gains, self._knots = bundle, Step(bundle), knots
        gains, q = self._gains, self._gains.count
        self._path: PathDerivatives | None = None
        terms = _Terms(gains.S, gains.N, gains.factors)
        if bundle.movement is not None:
            columns = {StateColumn.ey_m, StateColumn.epsi_rad, *tracked}
            columns &= {*range(n)[PATH_STATES]}
            self._path = PathDerivatives(bundle.movement, sorted(columns), stages)
            terms = terms.with_path(self._path)
        self.is_linear = len(terms.S) == 0
        self._follow = bundle.gains.follows if bundle.gains else Follow.PREDICTION

        # Nominal prediction: [a; psi; u; 1; t m - a o] of each stage. Where the gains follow it,
        # the part -a o is linear in psi and belongs to A.
        S, N = gains.S, gains.N
        self._saturates_apart = gains.has_saturation and self._follow is not Follow.PREDICTION
        linear = N * (0.0 if self._saturates_apart else gains.is_saturation)
        A, self._c = bundle.A - linear @ S, bundle.c - linear @ gains.s0
        self._prediction = np.zeros((stages + 1, q + n + m + 1 + q))
        self._prediction[:, q + n + m] = 1.0
        self.observables = self._prediction[:, q : q + n]
        """(N + 1, n), the nominal prediction"""
        self._inputs = self._prediction[:-1, q + n : q + n + m]
        to_psi = np.hstack([A, bundle.B_uc, np.zeros((n, 1)), N])
        self._step_map = np.vstack([S @ to_psi, to_psi])
        self._offsets, self._offset = self._step_map[:, n + m], np.zeros(n)
        self._factors = np.ones((stages, m + 2))
        """[u; kappa; 1] of each stage"""
        self._multipliers = np.zeros((stages, q))
        a = self._prediction[:-1, :q]
        self._t = np.zeros((stages, len(terms.S)))
        """what the inputs and the curvature are multiplied by in each term"""
        self._stages = [
            (
                self._prediction[k, q:],
                a[k],
                self._t[k, :q],
                a[k, gains.first_saturating :],
                self._t[k, gains.first_saturating : q],
                self._multipliers[k],
                self._prediction[k, q + n + m + 1 :],
                self._prediction[k + 1, : q + n],
            )
            for k in range(stages)
        ]

        variants = (ALL_INPUTS, *WITH_PEDAL.values())
        self._adjoints = {
            used.indices(m): _Adjoint(bundle, terms, knots, tracked, used) for used in variants
        }
        s, self._weights = len(tracked), np.zeros(self._t.shape)
        self._interpolation_T = np.ascontiguousarray(knots.interpolation.T)
        self.by_inputs = np.zeros((knots.count, s, m, knots.count))
        """(K, s, 3, K), derivatives of the tracked states at each end by the inputs at the knots"""
        self.by_curvature = np.zeros((knots.count, s))
        """(K, s), the same by the curvature"""
        self.by_psi = np.zeros((knots.count, s, n))
        """(K, s, n), the same by psi_0"""
        if self.is_linear:
            self._derive(ALL_INPUTS)

    def update(
        self,
        psi: Array,
        curvature_per_m: float,
        inputs: Array,
        used: slice = ALL_INPUTS,
    ) -> None:
        """Linearise along `inputs` (N, 3) from psi (n,).

        `used`: columns of the inputs by which derivatives are needed; the others are zero.
        """
        bundle, gains, offset = self._bundle, self._gains, self._offset
        np.multiply(bundle.B_uw[:, 0], curvature_per_m, out=offset)
        offset += self._c
        self._offsets[: gains.count] = gains.S @ offset + gains.s0
        self._offsets[gains.count :] = offset
        self.observables[0] = psi
        self._inputs[:] = inputs
        self._factors[:, :N_INPUTS], self._factors[:, N_INPUTS] = inputs, curvature_per_m
        np.take(self._factors, gains.factors, axis=1, out=self._multipliers, mode="clip")
        self._roll_out()
        if self._path is not None:
            self._follow_path(self._path, curvature_per_m)
        if self.is_linear:
            return
        weights, t = self._weights[:, : gains.count], self._t[:, : gains.count]
        np.multiply(t, t, out=weights)
        np.subtract(1.0, weights, out=weights)
        weights[:, : gains.first_saturating] = 1.0
        weights *= self._multipliers
        weights -= gains.is_saturation
        if self._follow is not Follow.PREDICTION:
            weights[:] = 0.0
        self._derive(used)

    def _roll_out(self) -> None:
        gains, step_map, followed = self._gains, self._step_map, self.observables[0]
        follows_prediction = self._follow is Follow.PREDICTION
        has_linear = gains.first_saturating > 0
        np.add(gains.S @ followed, gains.s0, out=self._prediction[0, : gains.count])
        for psi_u_1_forcing, a, t, a_tanh, t_tanh, m, value, following in self._stages:
            if not follows_prediction:
                np.add(gains.S @ followed, gains.s0, out=a)
                if self._follow is Follow.FREE_RESPONSE:
                    followed = self._bundle.A @ followed + self._offset
            if has_linear:
                t[:] = a
            np.tanh(a_tanh, out=t_tanh)
            np.multiply(t, m, out=value)
            if self._saturates_apart:
                np.subtract(value, a * gains.is_saturation, out=value)
            np.dot(step_map, psi_u_1_forcing, out=following)

    def _follow_path(self, derivatives: PathDerivatives, curvature_per_m: float) -> None:
        """Predict the path of the predicted motion, and weight its terms."""
        movement, of_path = self._bundle.movement, self.observables[:, PATH_STATES]
        assert movement is not None
        moved = self.observables[:-1] @ movement.S.T + movement.s0
        of_path[1:] = path_of(moved, curvature_per_m, of_path[0])
        q = self._gains.count
        self._weights[:, q:], self._t[:, q:] = derivatives.at(moved, curvature_per_m, of_path)

    def _derive(self, used: slice) -> None:
        knots, columns = self._knots, used
        is_nonzero: NDArray[np.bool_] = np.any(self._inputs, axis=0)
        is_nonzero[used] = False
        if is_nonzero.any():
            adjoint = self._adjoints[ALL_INPUTS.indices(N_INPUTS)]
        else:
            adjoint, columns = self._adjoints[used.indices(N_INPUTS)], ALL_INPUTS
        adjoint.propagate(self._weights, self._t)
        by_stage = adjoint.by_stage.reshape(knots.horizon, -1)
        shape = (knots.count, self.by_psi.shape[1], -1)
        self.by_psi[:] = adjoint.rows.reshape(shape)[::-1]
        by_knot = np.dot(self._interpolation_T, by_stage).reshape(knots.count, *shape)[:, ::-1]
        self.by_curvature[:] = by_stage.sum(axis=0).reshape(shape)[::-1, :, -1]
        self.by_inputs[:] = 0.0
        self.by_inputs[:, :, used] = by_knot[..., :-1][..., columns].transpose(1, 2, 3, 0)


class _Terms(NamedTuple):
    """Those of J that vary, N W S, and of which input or the curvature each is a factor."""

    S: Array
    """(q, n)"""
    N: Array
    """(n, q)"""
    factors: NDArray[np.int64]
    """(q,) columns of [u; kappa; 1]"""

    def with_path(self, path: PathDerivatives) -> "_Terms":
        by_curvature = np.full(len(path.S), N_INPUTS)
        return _Terms(
            np.vstack([self.S, path.S]),
            np.hstack([self.N, path.N]),
            np.concatenate([self.factors, by_curvature]),
        )


class _Adjoint:
    """Derivatives of the tracked states at the ends of the intervals, without some inputs.

    The inputs that are not `used` are zero in the plan, and the weights of their gains too.
    """

    def __init__(
        self, bundle: Bundle, terms: _Terms, knots: Knots, tracked: Sequence[int], used: slice
    ) -> None:
        n, stages, unit, s = len(bundle.A), knots.horizon, knots.unit, len(tracked)
        columns = [*range(N_INPUTS)[used], N_INPUTS]
        m = len(columns)
        """of the inputs and the curvature"""
        self._kept = np.flatnonzero(np.isin(terms.factors, [*columns, N_INPUTS + 1]))
        A, S, N = bundle.A, terms.S[self._kept], terms.N[:, self._kept]
        self._q = q = len(S)
        self._is_multiplied_by = np.eye(N_INPUTS + 2)[terms.factors[self._kept]][:, columns]
        self._t, self._weights = np.zeros((stages, q)), np.zeros((stages, q))
        forcing = np.hstack([N, bundle.B_uc[:, used], bundle.B_uw[:, :1]])
        maps = [A, forcing] if unit == 1 else [A @ A, A @ forcing, forcing]
        self._backward = np.ascontiguousarray(np.hstack(maps))
        self._to_psi = S if unit == 1 else np.vstack([S, S @ A])
        self._between = S @ forcing
        self._unit_rows = np.eye(n)[tracked]
        self.rows = np.zeros((knots.count * s, n))
        """(K s, n), the derivatives by psi_0, the last end first"""
        units, ends = stages // unit, set(knots.ends)
        self._begins_rows = [unit * (u + 1) in ends for u in range(units)]
        self._driven = np.zeros((len(self.rows), unit * q))
        self._mapped = np.zeros((units, len(self.rows), n + unit * (q + m)))
        """y through a unit of stages without its gains, then by the forcing of each stage"""
        by_forcing = self._mapped[:, :, n:].reshape(units, len(self.rows), unit, -1)
        self._by_forcing = by_forcing.transpose(0, 2, 1, 3)
        self._forcing = np.zeros((units, unit, q + m, m))
        """derivatives of [t m; u; kappa] by the inputs and by the curvature"""
        self._forcing[:, :, q:] = np.eye(m)
        self._of_gains = self._forcing.reshape(stages, q + m, m)[:, :q]
        self.by_stage = np.zeros((units, unit, len(self.rows), m))
        """derivatives by the used inputs and the curvature at each stage"""

    def propagate(self, weights: Array, t: Array) -> None:
        """Update the derivatives, with the weights and values (N, q) of all gains."""
        rows, to_psi, n, q = self.rows, self._to_psi, self.rows.shape[1], self._q
        np.take(weights, self._kept, axis=1, out=self._weights, mode="clip")
        np.take(t, self._kept, axis=1, out=self._t, mode="clip")
        np.multiply(self._t[:, :, None], self._is_multiplied_by, out=self._of_gains)
        weights, unit, tracked = self._weights, len(self._to_psi) // max(q, 1), self._unit_rows
        known = 0
        for u in range(len(self._mapped) - 1, -1, -1):
            if self._begins_rows[u]:
                rows[known : known + len(tracked)] = tracked
                known += len(tracked)
            y, driven, mapped = rows[:known], self._driven[:known], self._mapped[u, :known]
            np.dot(y, self._backward, out=mapped)
            if q == 0:
                y[:] = mapped[:, :n]
                continue
            last = mapped[:, -len(self._between.T) :][:, :q]
            np.multiply(last, weights[unit * (u + 1) - 1], out=driven[:, -q:])
            if unit == 2:
                first = mapped[:, n : n + len(self._between.T)]
                first += np.dot(driven[:, q:], self._between)
                np.multiply(first[:, :q], weights[2 * u], out=driven[:, :q])
            np.dot(driven, to_psi, out=y)
            y += mapped[:, :n]
        np.matmul(self._by_forcing, self._forcing, out=self.by_stage)
