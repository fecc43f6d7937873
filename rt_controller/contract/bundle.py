"""The model bundle: the one thing that training hands to the vehicle.

psi_(k+1) = A psi_k + B_eff u_k + B_uw w_k + c in physical units, where psi = [x; latents] is what
the encoder makes of what it is shown, and B_eff is constant or follows the first lifted state.
Paper: eqs. (6)-(8) and (14).
"""

import hashlib
import json
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.bilinear import Bilinear
from rt_controller.contract.lift import STATES_ONLY, Lift, LiftSample
from rt_controller.contract.schema import VEHICLE, Schema

Array = NDArray[np.float64]

SMALLEST_SPREAD = 1e-6
"""of an observable, as a share of its size: below, float32 cannot tell it from a constant"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bundle:
    """A lifted linear or bilinear model in physical units, with the encoder that lifts into it.

    `n` is the number of observables, the n_x states first; `m` inputs, `p` exogenous signals.
    """

    name: str
    """what kind of model, for summaries: "mdk-net", "lti" """
    schema: Schema = VEHICLE
    A: Array
    """(n, n)"""
    B_uc: Array
    """(n, m)"""
    B_uw: Array
    """(n, p)"""
    c: Array
    """(n,), the constant that centring left behind"""
    bilinear: Bilinear | None = None
    """None: B_uc is the whole input matrix"""
    lift: Lift = STATES_ONLY
    encoder_onnx: bytes
    selftest: LiftSample
    """of b instants"""
    selftest_psi: Array
    """(b, n) what the encoder made of them where it was trained"""
    training: str
    """resolved training configuration, JSON"""
    data_sha256: str
    """hash of the data set it was trained on"""

    @property
    def n_observables(self) -> int:
        return int(self.A.shape[0])

    @property
    def encoder_sha256(self) -> str:
        return hashlib.sha256(self.encoder_onnx).hexdigest()

    @property
    def sha256(self) -> str:
        """What the model is known by: it changes with everything that a prediction follows from.

        Over name, signals, period, lift, encoder and matrices; not over how the model was trained
        and is tested.
        """
        schema, lift = self.schema, self.lift
        bilinear = self.bilinear
        words = [
            self.name,
            [schema.states, schema.inputs, schema.exogenous, schema.dt_s],
            [lift.inputs, lift.history_steps, lift.history_fields],
            None if bilinear is None else bilinear.follows,
            self.encoder_sha256,
        ]
        digest = hashlib.sha256(json.dumps(words).encode())
        matrices = {"A": self.A, "B_uc": self.B_uc, "B_uw": self.B_uw, "c": self.c}
        if bilinear is not None:
            matrices |= {"N": bilinear.N, "S": bilinear.S, "s0": bilinear.s0}
        for key, matrix in matrices.items():
            array = np.ascontiguousarray(matrix, dtype="<f8")
            digest.update(f"{key} {array.shape}\n".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    def input_matrix(self, psi: Array) -> Array:
        """B_eff (..., n, m) at the lifted states psi (..., n) that `Bilinear` speaks of."""
        if self.bilinear is None:
            return np.broadcast_to(self.B_uc, (*psi.shape[:-1], *self.B_uc.shape))
        return self.B_uc + self.bilinear.added_columns(psi)

    @property
    def spectral_radius(self) -> float:
        return float(np.max(np.abs(np.linalg.eigvals(self.A))))

    @property
    def spread(self) -> Array:
        """(n,) standard deviation of each observable over the self-test instants.

        What counts as much or little of an observable, since metres, radians and latents share no
        unit. A constant is measured by its size instead, and by 1 if it is zero.
        """
        spread = self.selftest_psi.std(axis=0)
        size = np.abs(self.selftest_psi).max(axis=0)
        return np.where(spread > SMALLEST_SPREAD * size, spread, np.where(size > 0.0, size, 1.0))

    def growth(self, steps: int) -> float:
        """||A^steps||_2: how much an error may have grown, in units of `spread`, after `steps`."""
        scale = self.spread
        scaled = self.A * scale[None, :] / scale[:, None]
        return float(np.linalg.norm(np.linalg.matrix_power(scaled, steps), 2))

    def parity_error(self, psi: Array) -> float:
        """Largest difference between psi (b, n), lifted from the self-test, and the stored one.

        In units of `spread`; not a number if one of psi is none.
        """
        return float(np.max(np.abs(psi - self.selftest_psi) / self.spread))
