"""One protocol for every model: what will the car do under these inputs?

An evaluator, a rival and the shipped model meet here. Predictions are open loop: the lifted
state is made once, from the first state, and rolled out linearly, because that is what the
controller does over its horizon.
"""

import os
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.artifact import N_STATES, Bundle
from rt_controller.contract.errors import ArtifactError

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
import onnxruntime

Array = NDArray[np.float64]


class Predictor(Protocol):
    """A model of the car in physical units."""

    def predict(self, x0: Array, U: Array, kappa: Array) -> Array:
        """States (batch, K+1, 6), the first of them x0.

        x0 (batch, 6) as `VehicleState`, U (batch, K, 3) as `ControlInput`, kappa (batch,)
        curvature in 1/m, constant over the horizon.
        """
        ...


class BundlePredictor:
    """A model bundle, lifted by its encoder and rolled out in physical units.

    Raises:
        ArtifactError: the encoder cannot be loaded, or cannot lift a batch of states.
    """

    def __init__(self, bundle: Bundle) -> None:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        self._bundle = bundle
        options.log_severity_level = 3
        try:
            self._session = onnxruntime.InferenceSession(
                bundle.encoder_onnx, sess_options=options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # onnxruntime raises many types, none of them public
            raise ArtifactError(
                f"encoder.onnx: expected an ONNX model, found something onnxruntime cannot load "
                f"({error}). Run offline-export again."
            ) from error

    def lift(self, x: Array) -> Array:
        """Observables (batch, n) of states (batch, 6)."""
        expected = (len(x), self._bundle.n_observables)
        try:
            (psi,) = self._session.run(["psi"], {"x": x.astype(np.float32)})
        except Exception as error:  # as above
            raise ArtifactError(
                f"encoder.onnx: expected an encoder that lifts states {x.shape}, found that it "
                f"cannot ({error}). Run offline-export again."
            ) from error
        if psi.shape != expected:
            raise ArtifactError(
                f"encoder.onnx: expected observables {expected}, found {psi.shape}. Run "
                f"offline-export again."
            )
        return np.asarray(psi, dtype=np.float64)

    def predict(self, x0: Array, U: Array, kappa: Array) -> Array:
        """States (batch, K+1, 6). Paper: eqs. (6)-(8)."""
        A, B_uc = self._bundle.A, self._bundle.B_uc
        constant = kappa[:, None] * self._bundle.B_uw[:, 0] + self._bundle.c
        psi = self.lift(x0)
        states = np.empty((len(x0), U.shape[1] + 1, N_STATES))
        states[:, 0] = x0
        for k in range(U.shape[1]):
            psi = psi @ A.T + U[:, k] @ B_uc.T + constant
            states[:, k + 1] = psi[:, :N_STATES]
        return states
