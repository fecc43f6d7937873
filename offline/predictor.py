"""One protocol for every model: what will the car do under these inputs?

An evaluator, a rival and the shipped model meet here. Predictions are open loop: the lifted
state is made once, from the first state, and never again, because that is what the
controller does over its horizon.
"""

import os
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.artifact import Bundle, LiftSample
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.follow import Follow

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
import onnxruntime

Array = NDArray[np.float64]


class Predictor(Protocol):
    """A model of the car in physical units."""

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n), the first of them x0.

        x0 (batch, n) states; past (batch, H, h) what happened right before, as
        `Trajectories.past`, of which a model takes the last rows it needs; U (batch, K, m) inputs
        and W (batch, K, p) exogenous signals, each held over its step.
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

    def lift(self, sample: LiftSample) -> Array:
        """Observables (batch, n) of these instants, physical states in double precision."""
        x = sample.x
        expected = (len(x), self._bundle.n_observables)
        shown = {
            name: getattr(sample, name).astype(np.float32) for name in self._bundle.lift.inputs
        }
        try:
            (psi,) = self._session.run(["psi"], shown)
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
        return np.concatenate([x, psi[:, x.shape[1] :].astype(np.float64)], axis=1)

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n). Paper: eqs. (6)-(8)."""
        bundle = self._bundle
        history = past[:, past.shape[1] - bundle.lift.history_steps :]
        psi = self.lift(LiftSample(x0, W[:, 0], history))
        follows = None if bundle.bilinear is None else bundle.bilinear.follows
        B_eff, followed = bundle.input_matrix(psi), psi
        states = np.empty((len(x0), U.shape[1] + 1, x0.shape[1]))
        states[:, 0] = x0
        for k in range(U.shape[1]):
            undriven = W[:, k] @ bundle.B_uw.T + bundle.c
            psi = psi @ bundle.A.T + np.einsum("bnm,bm->bn", B_eff, U[:, k]) + undriven
            states[:, k + 1] = psi[:, : x0.shape[1]]
            if follows is Follow.PREDICTION:
                followed = psi
            elif follows is Follow.FREE_RESPONSE:
                followed = followed @ bundle.A.T + undriven
            else:
                continue
            B_eff = bundle.input_matrix(followed)
        return states
