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

        # Nominal prediction: [psi; 1] of each stage, and [A psi + offset; a].
        self._extended = np.ones((stages + 1, n + 1))
        self.observables = self._extended[:, :n]
        """(N + 1, n), the nominal prediction"""
        self._step_map = np.zeros((n + q, n + 1))
        self._step_map[:n, :n], self._step_map[n:, :n] = bundle.A, gains.S
        self._step_map[n:, n] = gains.s0
        self._offset = self._step_map[:n, n]
        self._forcing_map = np.hstack([gains.N, bundle.B_uc])
        self._products = np.zeros((stages, n + q))
        self._t, self._multipliers = np.zeros((stages, q)), np.zeros((stages, q))
        self._forcing = np.zeros((stages, q + m))
        """t m - a o, then u"""
        self._change, self._followed = np.zeros(n), np.zeros(n)
        first = gains.first_saturating
        self._stages = [
            (
                self._extended[k],
                self._products[k],
                self._products[k, :n],
                self._products[k, n:],
                self._t[k],
                self._products[k, n + first :],
                self._t[k, first:],
                self._multipliers[k],
                self._forcing[k, :q],
                self._forcing[k],
                self.observables[k + 1],
            )
            for k in range(stages)
        ]

        # Derivatives: rows of the tracked states at the ends, the last end first.
        A, S, N = bundle.A, gains.S, gains.N
        self._weights = np.zeros((stages, q))
        self._columns = np.zeros((stages, m + 1, n))
        """derivatives of psi+ by the inputs and by the curvature"""
        self._forward = np.ascontiguousarray(np.hstack([A.T, S.T])), np.ascontiguousarray(N.T)
        pair = knots.unit == 2
        maps = np.hstack([A @ A, N, A @ N]) if pair else np.hstack([A, N])
        self._backward = np.ascontiguousarray(maps), np.vstack([S @ A, S]) if pair else S
        self._between = S @ N
        self._unit_rows = np.eye(n)[tracked]
        s = self._tracked = len(tracked)
        self._rows = np.zeros((knots.count * s, n))
        units = stages // knots.unit
        ends = set(knots.ends)
        self._begins_rows = [knots.unit * (u + 1) in ends for u in range(units)]
        self._by_unit = np.zeros((units, len(self._rows), knots.unit * m + 1))
        self.by_inputs = np.zeros((knots.count, s, m, knots.count))
        """(K, s, 3, K), derivatives of the tracked states at each end by the inputs at the knots"""
        self.by_curvature = np.zeros((knots.count, s))
        """(K, s), the same by the curvature"""
        self.by_psi = np.zeros((knots.count, s, n))
        """(K, s, n), the same by psi_0"""
        if self.is_linear:
            self._columns[:, :m], self._columns[:, m] = bundle.B_uc.T, bundle.B_uw[:, 0]
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
        bundle, gains = self._bundle, self._gains
        np.multiply(bundle.B_uw[:, 0], curvature_per_m, out=self._offset)
        self._offset += bundle.c
        self._offset[:N_STATES] += disturbance
        self.observables[0] = psi
        self._forcing[:, gains.count :] = inputs
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
        for i in range(N_INPUTS)[used]:
            self._columns[:, i] = np.dot(t[:, gains.of_input[i]], gains.N_of_input[i])
            self._columns[:, i] += bundle.B_uc[:, i]
        self._columns[:, -1] = np.dot(t[:, gains.of_curvature], gains.N_of_curvature)
        self._columns[:, -1] += bundle.B_uw[:, 0]
        self._propagate(used)

    def jacobian(self) -> Array:
        """(n, n), the derivative of psi+ by psi at the first stage."""
        return np.asarray(self._bundle.A + (self._gains.N * self._weights[0]) @ self._gains.S)

    def _roll_out(self) -> None:
        step_map, forcing_map, change = self._step_map, self._forcing_map, self._change
        gains, n = self._gains, len(change)
        saturations = gains.is_saturation if gains.has_saturation else None
        followed = None if self._follow is Follow.PREDICTION else self._followed
        if followed is not None:
            followed[:] = self.observables[0]
        for psi_1, product, moved, a, t, a_tanh, t_tanh, m, value, forcing, psi in self._stages:
            np.dot(step_map, psi_1, out=product)
            if followed is not None:
                a[:] = step_map[n:, :n] @ followed + step_map[n:, n]
                if self._follow is Follow.FREE_RESPONSE:
                    followed[:] = step_map[:n, :n] @ followed + self._offset
            t[:] = a
            np.tanh(a_tanh, out=t_tanh)
            np.multiply(t, m, out=value)
            if saturations is not None:
                np.subtract(value, a * saturations, out=value)
            np.dot(forcing_map, forcing, out=change)
            np.add(moved, change, out=psi)

    def _propagate(self, used: slice) -> None:
        rows, weights, knots = self._rows, self._weights, self._knots
        (maps, S), n, q = self._backward, self._rows.shape[1], self._gains.count
        M, by_unit = len(range(N_INPUTS)[used]), self._by_unit
        columns = self._columns_of_units(used)
        known = 0
        for u in range(len(columns) - 1, -1, -1):
            if self._begins_rows[u]:
                rows[known : known + self._tracked] = self._unit_rows
                known += self._tracked
            y = rows[:known]
            by_unit[u, :known, : columns.shape[2]] = np.dot(y, columns[u])
            mapped = np.dot(y, maps)
            if q == 0:
                y[:] = mapped[:, :n]
                continue
            driven = mapped[:, n:]
            driven[:, :q] *= weights[knots.unit * (u + 1) - 1]
            if knots.unit == 2:
                driven[:, q:] += np.dot(driven[:, :q], self._between)
                driven[:, q:] *= weights[2 * u]
            np.dot(driven, S, out=y)
            y += mapped[:, :n]
        shape = (knots.count, self._tracked)
        by_unit = by_unit[:, :, : knots.unit * M + 1]
        self.by_psi[:] = rows.reshape(*shape, n)[::-1]
        self.by_curvature[:] = by_unit[:, :, -1].sum(axis=0).reshape(shape)[::-1]
        by_input = by_unit[:, :, :-1].reshape(len(by_unit), len(rows), knots.unit, M)
        by_stage = by_input.transpose(1, 3, 0, 2).reshape(len(rows) * M, -1)
        by_knot = np.dot(by_stage, knots.interpolation).reshape(*shape, M, knots.count)
        self.by_inputs[:] = 0.0
        self.by_inputs[:, :, used] = by_knot[::-1]

    def _columns_of_units(self, used: slice) -> Array:
        """(U, n, r M + 1), derivatives of psi at the end of each unit of r stages.

        By the inputs of its stages, and by the curvature.
        """
        inputs, curvature, n = (
            self._columns[:, :-1][:, used],
            self._columns[:, -1:],
            len(self._change),
        )
        if self._knots.unit == 1:
            return np.concatenate((inputs, curvature), axis=1).transpose(0, 2, 1)
        maps, N_T = self._forward
        first = np.concatenate((inputs[::2], curvature[::2]), axis=1)
        mapped = np.dot(first.reshape(-1, n), maps)
        driven = mapped[:, n:].reshape(*first.shape[:2], -1) * self._weights[1::2, None]
        moved = mapped[:, :n] + np.dot(driven.reshape(len(mapped), -1), N_T)
        moved = moved.reshape(first.shape)
        moved[:, -1] += curvature[1::2, 0]
        columns = np.concatenate((moved[:, :-1], inputs[1::2], moved[:, -1:]), axis=1)
        return columns.transpose(0, 2, 1)


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
        self.of_input = [slice(i, split, m) for i in range(m)]
        self.of_curvature = split + np.flatnonzero(self._signals >= 0)
        self.N_of_input = [np.ascontiguousarray(self.N[:, of].T) for of in self.of_input]
        self.N_of_curvature = np.ascontiguousarray(self.N[:, self.of_curvature].T)

    def write_multipliers(self, inputs: Array, curvature_per_m: float, out: Array) -> None:
        """Write what each gain is multiplied by (N, q), under `inputs` (N, 3)."""
        split = self._rank * inputs.shape[1]
        if split:
            out[:, :split].reshape(len(inputs), self._rank, -1)[:] = inputs[:, None]
        if self.count > split:
            out[:, split:] = np.where(self._signals >= 0, curvature_per_m, 1.0)
