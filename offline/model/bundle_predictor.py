"""A model bundle as a predictor: lifted by its encoder, rolled out in physical units."""

import numpy as np

from offline.data.signals import last_rows
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError
from rt_controller.control.lift import open_encoder
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import roll_out
from rt_controller.model.lift import LiftSample


class BundlePredictor:
    """Implements `offline.evaluation.predictor.Predictor` for a bundle.

    Raises:
        ArtifactError: the encoder cannot be loaded, or cannot lift a batch of states.
    """

    def __init__(self, bundle: Bundle) -> None:
        self._bundle, self._session = bundle, open_encoder(bundle)

    def lift(self, sample: LiftSample) -> Array:
        """Observables (batch, n) of these instants; the states among them in double precision."""
        x = sample.x
        expected = (len(x), self._bundle.n_observables)
        inputs = {
            name: getattr(sample, name).astype(np.float32) for name in self._bundle.lift.inputs
        }
        try:
            (psi,) = self._session.run(["psi"], inputs)
        except Exception as error:  # onnxruntime raises many types, none public
            raise ArtifactError(
                f"encoder.onnx: expected an encoder that lifts states {x.shape}, found that it "
                f"cannot ({error}). Run offline-export again."
            ) from error
        # The number of rows is open in the file, so it is known only now.
        if psi.shape != expected:
            raise ArtifactError(
                f"encoder.onnx: expected observables {expected}, found {psi.shape}. Run "
                f"offline-export again."
            )
        return np.concatenate([x, psi[:, x.shape[1] :].astype(np.float64)], axis=1)

    def predict(self, x0: Array, past: Array, U: Array, W: Array) -> Array:
        """States (batch, K+1, n_x): lifted once, at x0, then rolled out. Paper: eqs. (6)-(8)."""
        history = last_rows(past, self._bundle.lift.history_steps)
        psi0 = self.lift(LiftSample(x0, W[:, 0], history))
        return roll_out(self._bundle, psi0, U, W, x0.shape[1])
