"""psi = [x; phi(x)]: the encoder of a bundle, run by onnxruntime in preallocated memory."""

import os

import numpy as np

from rt_controller.contract.artifact import N_STATES, Array, Bundle
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import VehicleState

# onnxruntime starts a telemetry thread on import unless it is told not to.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

import onnxruntime as ort

SELFTEST_TOLERANCE = 1e-5


class Encoder:
    """The lift of one bundle, for one state a tick or a batch of them.

    Raises:
        ArtifactError: the file is not an ONNX model, takes or gives other tensors than this
            controller, or does not reproduce the bundle's self-test pairs.

    Paper: eq. (7).
    """

    def __init__(self, bundle: Bundle) -> None:
        self._session = _open(bundle)
        n = bundle.n_observables
        self._x = np.zeros((1, N_STATES), dtype=np.float32)
        self._psi = np.zeros((1, n), dtype=np.float32)
        self.psi = np.zeros(n)
        """(n,), the last lifted state; overwritten by the next"""
        # An OrtValue made from a numpy array aliases its memory: writing in place is feeding it.
        self._binding = self._session.io_binding()
        self._binding.bind_ortvalue_input("x", ort.OrtValue.ortvalue_from_numpy(self._x))
        self._binding.bind_ortvalue_output("psi", ort.OrtValue.ortvalue_from_numpy(self._psi))
        self._check(bundle)

    def lift(self, state: VehicleState) -> Array:
        """psi (n,) of one state; the physical part keeps its double precision."""
        self._x[0] = state
        self._session.run_with_iobinding(self._binding)
        self.psi[:] = self._psi[0]
        self.psi[:N_STATES] = state
        return self.psi

    def lift_batch(self, states: Array) -> Array:
        """psi (batch, n) of states (batch, 6)."""
        (psi,) = self._session.run(["psi"], {"x": states.astype(np.float32)})
        lifted: Array = psi.astype(np.float64)
        lifted[:, :N_STATES] = states
        return lifted

    def _check(self, bundle: Bundle) -> None:
        found = np.stack([self.lift(VehicleState(*row)).copy() for row in bundle.selftest_x])
        # Latents have no unit: their error counts against the size they have.
        size = np.maximum(np.abs(bundle.selftest_psi).max(axis=0), 1.0)
        worst = float(np.max(np.abs(found - bundle.selftest_psi) / size))
        if not worst < SELFTEST_TOLERANCE:
            raise ArtifactError(
                f"encoder.onnx does not pass its self-test: expected the stored pairs within "
                f"{SELFTEST_TOLERANCE:g}, found a difference of {worst:.3g}. The two files are not "
                f"of one export: run offline-export again."
            )


def _open(bundle: Bundle) -> ort.InferenceSession:
    options = ort.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        session = ort.InferenceSession(
            bundle.encoder_onnx, options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:  # onnxruntime raises many types, none of them public
        raise ArtifactError(
            f"encoder.onnx: expected an ONNX model, found something onnxruntime cannot load "
            f"({str(error).splitlines()[0]}). Run offline-export again."
        ) from error
    found = (
        [(i.name, i.type, i.shape[-1]) for i in session.get_inputs()],
        [(o.name, o.type, o.shape[-1]) for o in session.get_outputs()],
    )
    expected = (
        [("x", "tensor(float)", N_STATES)],
        [("psi", "tensor(float)", bundle.n_observables)],
    )
    if found != expected:
        raise ArtifactError(
            f"encoder.onnx: expected inputs and outputs {expected}, found {found}. This bundle was "
            f"made for another controller: run offline-export of the same version."
        )
    return session
