"""psi = [x; phi(x)]: the encoder of a bundle, run by onnxruntime in preallocated memory."""

import os
from collections.abc import Sequence

import numpy as np

from rt_controller.contract.artifact import N_STATES, Array, Bundle
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import VehicleState

# onnxruntime starts a telemetry thread on import unless it is told not to.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

import onnxruntime as ort

SELFTEST_TOLERANCE = 1e-4
"""in units of each observable's spread. Export asks for 1e-5 on one machine; here another
processor may sum in another order, which is no fault of the model"""


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
        try:
            found = np.stack([self.lift(VehicleState(*row)).copy() for row in bundle.selftest_x])
        except Exception as error:  # onnxruntime raises many types, none of them public
            raise ArtifactError(
                f"encoder.onnx: expected an encoder that lifts one state, found that it cannot "
                f"({_first_line(error)}). Run offline-export again."
            ) from error
        worst = bundle.parity_error(found)
        if not worst < SELFTEST_TOLERANCE:
            raise ArtifactError(
                f"encoder.onnx does not pass its self-test: expected the stored pairs within "
                f"{SELFTEST_TOLERANCE:g} of the spread of each observable, found a difference of "
                f"{worst:.3g}. The encoder is not the one that was exported, or onnxruntime "
                f"computes it with less than float32: run offline-export again."
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
            f"({_first_line(error)}). Run offline-export again."
        ) from error
    _check_tensors("input", session.get_inputs(), "x", N_STATES)
    _check_tensors("output", session.get_outputs(), "psi", bundle.n_observables)
    return session


def _check_tensors(what: str, found: Sequence[ort.NodeArg], name: str, width: int) -> None:
    """Return if there is one tensor: float (any batch, width)."""
    if len(found) == 1:
        shape = found[0].shape
        fits = len(shape) == 2 and not isinstance(shape[0], int) and shape[1] == width
        if fits and (found[0].name, found[0].type) == (name, "tensor(float)"):
            return
    listed = ", ".join(f"{tensor.name}: {tensor.type} {tensor.shape}" for tensor in found)
    raise ArtifactError(
        f"encoder.onnx: expected one {what} {name}: tensor(float) ['batch', {width}] for any "
        f"batch, found {listed or 'none'}. This bundle was made for another controller: run "
        f"offline-export of the same version."
    )


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)
