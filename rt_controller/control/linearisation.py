"""The model along a plan: the predicted states, and their derivatives by the inputs."""

from collections.abc import Sequence

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.follow import Follow
from rt_controller.contract.schema import N_INPUTS, N_STATES
from rt_controller.control.knots import Knots

ALL_INPUTS = slice(None)


class Linearisation:
    """Predicted states under nominal inputs, and their exact derivatives, in preallocated memory.

    All gains of a model, those of its inputs and those of its drift, are functions of one number
    each: a = S psi + s0. With t = tanh(a), or a where the gain does not saturate,

        psi+ = A psi + B_uc u + N (t m - a o) + B_uw kappa + c + d

    where m is what the gain is multiplied by (an input, the curvature, or 1), and o is 1 for a
    saturation tanh(a) - a. So the derivative of psi+ by psi is J = A + N W S with the diagonal
    matrix W = diag(m t' - o), and that by an input is its column of B_uc plus N t over its gains.
    One QP a period is one iteration of a sequential quadratic program.

    The derivatives of the tracked states are propagated backwards (adjoint equation), from the end
    of each interval between two knots to the present: a row y' becomes y' J. Where all knots lie on
    even stages, two stages are one product,

        J' J = (A + N W' S)(A + N W S) = A A + N W' S A + (A N + N W' S N) W S,

    of which only W and W' depend on the plan.

    Gains that follow the first state or the free response do not depend on the inputs: then J = A.

    Paper: eq. (14), with the bilinear model that its conclusion names.
    """

    def __init__(self, bundle: Bundle, knots: Knots, tracked: Sequence[int]) -> None:
        """`tracked`: columns of the states whose derivatives are needed."""
        n, m, stages = bundle.n_observables, N_INPUTS, knots.horizon
        self._bundle, self._gains, self._knots = bundle, Gains(bundle), knots
        gains, q = self._gains, self._gains.count
        self.is_linear = q == 0
        self._follow = bundle.bilinear.follows if bundle.bilinear else Follow.PREDICTION

        # Nominal prediction: [a; psi; u; 1; t m - a o] of each stage.
        A, S, N = bundle.A, gains.S, gains.N
        self._prediction = np.zeros((stages + 1, q + n + m + 1 + q))
        self._prediction[:, q + n + m] = 1.0
        self.observables = self._prediction[:, q : q + n]
        """(N + 1, n), the nominal prediction"""
        self._inputs = self._prediction[:-1, q + n : q + n + m]
        to_psi = np.hstack([A, bundle.B_uc, np.zeros((n, 1)), N])
        self._step_map = np.vstack([S @ to_psi, to_psi])
        self._offsets, self._offset = self._step_map[:, n + m], np.zeros(n)
        self._multipliers = np.zeros((stages, q))
        a = self._prediction[:-1, :q]
        self._t = a if gains.first_saturating == q else np.zeros((stages, q))
        self._stages = [
            (
                self._prediction[k, q:],
                a[k],
                self._t[k],
                self._t[k, gains.first_saturating :],
                self._multipliers[k],
                self._prediction[k, q + n + m + 1 :],
                self._prediction[k + 1, : q + n],
            )
            for k in range(stages)
        ]

        # Derivatives: rows y of the tracked states at the ends, the last end first.
        unit, s = knots.unit, len(tracked)
        self._tracked = s
        self._weights = np.zeros((stages, q))
        forcing = np.hstack([N, bundle.B_uc, bundle.B_uw[:, :1]])
        maps = [A, forcing] if unit == 1 else [A @ A, A @ forcing, forcing]
        self._backward = np.ascontiguousarray(np.hstack(maps))
        self._to_psi = S if unit == 1 else np.vstack([S, S @ A])
        self._between = S @ forcing
        self._unit_rows = np.eye(n)[tracked]
        self._rows = np.zeros((knots.count * s, n))
        units, ends = stages // unit, set(knots.ends)
        self._begins_rows = [unit * (u + 1) in ends for u in range(units)]
        self._driven = np.zeros((len(self._rows), unit * q))
        self._mapped = np.zeros((units, len(self._rows), n + unit * (q + m + 1)))
        """y through a unit of stages without its gains, then by the forcing of each stage"""
        by_forcing = self._mapped[:, :, n:].reshape(units, len(self._rows), unit, -1)
        self._by_forcing = by_forcing.transpose(0, 2, 1, 3)
        self._forcing = np.zeros((units, unit, q + m + 1, m + 1))
        """derivatives of [t m; u; kappa] by the inputs and by the curvature"""
        self._forcing[:, :, q:] = np.eye(m + 1)
        self._of_gains = self._forcing.reshape(stages, q + m + 1, m + 1)[:, :q]
        self._interpolation_T = np.ascontiguousarray(knots.interpolation.T)
        self.by_inputs = np.zeros((knots.count, s, m, knots.count))
        """(K, s, 3, K), derivatives of the tracked states at each end by the inputs at the knots"""
        self.by_curvature = np.zeros((knots.count, s))
        """(K, s), the same by the curvature"""
        self.by_psi = np.zeros((knots.count, s, n))
        """(K, s, n), the same by psi_0"""
        if self.is_linear:
            self._propagate(ALL_INPUTS)

    def update(
        self,
        psi: Array,
        curvature_per_m: float,
        inputs: Array,
        disturbance: Array,
        used: slice = ALL_INPUTS,
    ) -> None:
        """Linearise along `inputs` (N, 3) from psi (n,), with a constant `disturbance` (6,).

        `used`: columns of the inputs by which derivatives are needed; the others are zero.
        """
        bundle, gains, offset = self._bundle, self._gains, self._offset
        np.multiply(bundle.B_uw[:, 0], curvature_per_m, out=offset)
        offset += bundle.c
        offset[:N_STATES] += disturbance
        self._offsets[: gains.count] = gains.S @ offset + gains.s0
        self._offsets[gains.count :] = offset
        self.observables[0] = psi
        self._inputs[:] = inputs
        gains.write_multipliers(inputs, curvature_per_m, self._multipliers)
        self._roll_out()
        if self.is_linear:
            return
        weights, t = self._weights, self._t
        np.multiply(t, t, out=weights)
        np.subtract(1.0, weights, out=weights)
        weights[:, : gains.first_saturating] = 1.0
        weights *= self._multipliers
        weights -= gains.is_saturation
        if self._follow is not Follow.PREDICTION:
            weights[:] = 0.0
        np.multiply(t[:, :, None], gains.is_multiplied_by, out=self._of_gains)
        self._propagate(used)

    def jacobian(self) -> Array:
        """(n, n), the derivative of psi+ by psi at the first stage."""
        return np.asarray(self._bundle.A + (self._gains.N * self._weights[0]) @ self._gains.S)

    def _roll_out(self) -> None:
        gains, step_map, followed = self._gains, self._step_map, self.observables[0]
        follows_prediction = self._follow is Follow.PREDICTION
        saturations = gains.is_saturation if gains.has_saturation else None
        np.add(gains.S @ followed, gains.s0, out=self._prediction[0, : gains.count])
        for psi_u_1_forcing, a, t, t_tanh, m, value, following in self._stages:
            if not follows_prediction:
                np.add(gains.S @ followed, gains.s0, out=a)
                if self._follow is Follow.FREE_RESPONSE:
                    followed = self._bundle.A @ followed + self._offset
            if t is not a:
                t[:] = a
                np.tanh(t_tanh, out=t_tanh)
            np.multiply(t, m, out=value)
            if saturations is not None:
                np.subtract(value, a * saturations, out=value)
            np.dot(step_map, psi_u_1_forcing, out=following)

    def _propagate(self, used: slice) -> None:
        rows, weights, knots, to_psi = self._rows, self._weights, self._knots, self._to_psi
        n, q, unit = rows.shape[1], self._gains.count, knots.unit
        known = 0
        for u in range(len(self._mapped) - 1, -1, -1):
            if self._begins_rows[u]:
                rows[known : known + self._tracked] = self._unit_rows
                known += self._tracked
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
        by_stage = np.matmul(self._by_forcing, self._forcing).reshape(knots.horizon, -1)
        shape = (knots.count, self._tracked, N_INPUTS + 1)
        self.by_psi[:] = rows.reshape(*shape[:2], n)[::-1]
        self.by_curvature[:] = by_stage.sum(axis=0).reshape(shape)[::-1, :, -1]
        by_knot = np.dot(self._interpolation_T, by_stage).reshape(-1, *shape)[:, ::-1]
        self.by_inputs[:] = 0.0
        self.by_inputs[:, :, used] = by_knot[..., :-1][..., used].transpose(1, 2, 3, 0)


class Gains:
    """All gains of a model in one list: S (q, n), s0 (q,), N (n, q)."""

    def __init__(self, bundle: Bundle) -> None:
        n, m = bundle.B_uc.shape
        S, s0, N = [np.zeros((0, n))], [np.zeros(0)], [np.zeros((n, 0))]
        self._rank = 0
        self.first_saturating = 0
        if bundle.bilinear is not None:
            bilinear = bundle.bilinear
            self._rank = bilinear.rank
            S.append(bilinear.S.reshape(-1, n))
            s0.append(bilinear.s0.reshape(-1))
            N.append(bilinear.N.transpose(1, 0, 2).reshape(n, -1))
            self.first_saturating = 0 if bilinear.saturates else bilinear.s0.size
        split = self._rank * m
        saturation = [np.zeros(split)]
        self._signals = np.zeros(0, dtype=np.int64)
        if bundle.drift is not None:
            S.append(bundle.drift.S)
            s0.append(bundle.drift.s0)
            N.append(bundle.drift.N)
            saturation.append(bundle.drift.is_saturation.astype(np.float64))
            self._signals = bundle.drift.signal
        self.S, self.s0, self.N = np.concatenate(S), np.concatenate(s0), np.concatenate(N, axis=1)
        self.count = len(self.s0)
        self.is_saturation = np.concatenate(saturation)
        self.has_saturation = bool(self.is_saturation.any())
        self.is_multiplied_by = np.zeros((self.count, m + 1))
        """1 where a gain is multiplied by an input or, the last column, by the curvature"""
        self.is_multiplied_by[:split, :m] = np.tile(np.eye(m), (self._rank, 1))
        self.is_multiplied_by[split:, m] = self._signals >= 0

    def write_multipliers(self, inputs: Array, curvature_per_m: float, out: Array) -> None:
        """Write what each gain is multiplied by (N, q), under `inputs` (N, 3)."""
        split = self._rank * inputs.shape[1]
        if split:
            out[:, :split].reshape(len(inputs), self._rank, -1)[:] = inputs[:, None]
        if self.count > split:
            out[:, split:] = np.where(self._signals >= 0, curvature_per_m, 1.0)
