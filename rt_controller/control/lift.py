"""Lifted state psi = [x; phi(x, w, history)], by the encoder of a bundle and onnxruntime."""

import os
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import N_STATES, ControlInput, VehicleState
from rt_controller.model.bundle import Bundle

# onnxruntime starts a telemetry thread on import unless it is told not to.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

import onnxruntime as ort

Rows = NDArray[np.float32]
SELFTEST_TOLERANCE = 1e-4
"""in units of each observable's spread. Export requires 1e-5 on one machine; another processor may
sum in another order"""
_EXTERNAL_DATA = b"location"
"""key, in an ONNX file, of the other file in which a tensor has its numbers"""


class Encoder:
    """The lift of one bundle, in preallocated memory.

    Raises:
        ArtifactError: it cannot be opened, or does not reproduce its self-test pairs.

    Paper: eq. (7).
    """

    def __init__(self, bundle: Bundle) -> None:
        """`bundle` has the signals of the car (`validation.require_drivable`)."""
        shapes = _input_shapes(bundle)
        self._session = open_encoder(bundle)
        inputs = {name: np.zeros((1, *shape), dtype=np.float32) for name, shape in shapes.items()}
        self._x, self._w = inputs["x"], inputs.get("w", np.zeros((1, 1), dtype=np.float32))
        self.history: Rows | None = inputs["history"][0] if "history" in shapes else None
        """(H, h), the history that `lift` reads: to be written in place"""
        n = bundle.n_observables
        self._psi = np.zeros((1, n), dtype=np.float32)
        self.psi = np.zeros(n)
        """(n,), the last lifted state; overwritten by the next"""
        # An OrtValue made from a numpy array shares its memory, so inputs are written in place.
        self._binding = self._session.io_binding()
        for name, array in inputs.items():
            self._binding.bind_ortvalue_input(name, ort.OrtValue.ortvalue_from_numpy(array))
        self._binding.bind_ortvalue_output("psi", ort.OrtValue.ortvalue_from_numpy(self._psi))
        self._check(bundle)

    def lift(self, state: VehicleState, curvature_per_m: float) -> Array:
        """psi (n,) of a state, with the present `history`; the states keep double precision."""
        self._x[0] = state
        self._w[0, 0] = curvature_per_m
        self._session.run_with_iobinding(self._binding)
        self.psi[:] = self._psi[0]
        self.psi[:N_STATES] = state
        return self.psi

    def _check(self, bundle: Bundle) -> None:
        try:
            found = np.zeros((len(bundle.selftest.x), bundle.n_observables))
            for i, (x, w, history) in enumerate(zip(*bundle.selftest, strict=True)):
                if self.history is not None:
                    self.history[:] = history
                found[i] = self.lift(VehicleState(*x), w[0])
        except Exception as error:  # onnxruntime raises many types, none public
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


def _input_shapes(bundle: Bundle) -> dict[str, tuple[int, ...]]:
    """Shape of each input of the encoder, without the batch."""
    lift, schema = bundle.lift, bundle.schema
    shapes = {
        "x": (len(schema.states),),
        "w": (len(schema.exogenous),),
        "history": (lift.history_steps, len(lift.history_fields)),
    }
    return {name: shapes[name] for name in lift.inputs}


def open_encoder(bundle: Bundle) -> ort.InferenceSession:
    """The encoder of a bundle of any signals, on one thread.

    Raises:
        ArtifactError: it is not an ONNX model that contains its data, or has other tensors than
            the bundle says.
    """
    if _EXTERNAL_DATA in bundle.encoder_onnx:  # onnxruntime would read it, outside the hash
        raise ArtifactError(
            "encoder.onnx: expected an encoder that contains its data, found data in another file. "
            "Run offline-export again."
        )
    options = ort.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        session = ort.InferenceSession(
            bundle.encoder_onnx, options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:  # onnxruntime raises many types, none public
        raise ArtifactError(
            f"encoder.onnx: expected an ONNX model, found something onnxruntime cannot load "
            f"({_first_line(error)}). Run offline-export again."
        ) from error
    _check_tensors("input", session.get_inputs(), _input_shapes(bundle))
    _check_tensors("output", session.get_outputs(), {"psi": (bundle.n_observables,)})
    return session


def _check_tensors(
    what: str, found: Sequence[ort.NodeArg], expected: Mapping[str, tuple[int, ...]]
) -> None:
    """Refuse tensors that are not exactly the expected ones: float (any batch, *shape)."""
    shapes = {
        tensor.name: tuple(tensor.shape[1:])
        for tensor in found
        if tensor.type == "tensor(float)" and tensor.shape and not isinstance(tensor.shape[0], int)
    }
    if shapes == expected and len(found) == len(expected):
        return
    required = ", ".join(f"{name}: tensor(float) {['batch', *s]}" for name, s in expected.items())
    listed = ", ".join(f"{tensor.name}: {tensor.type} {tensor.shape}" for tensor in found)
    raise ArtifactError(
        f"encoder.onnx: expected {len(expected)} {what} {required} for any batch, found "
        f"{listed or 'none'}. The encoder is not the one this bundle describes: run "
        f"offline-export of the same version."
    )


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)


class History:
    """The last H pairs of a state and the input that acted from it to the next, oldest first.

    Before the oldest observed state the car is assumed to have been in that state all the time,
    under the input that was applied when it was observed. So the first tick is defined, and after
    H periods no row depends on the assumption.
    """

    def __init__(self, rows: Rows) -> None:
        """`rows` (H, 6), columns as `validation.DRIVABLE_HISTORY`: the encoder's memory."""
        self._rows = rows
        self._present: VehicleState | None = None

    def advance(self, state: VehicleState, held: ControlInput) -> None:
        """Add the present `state`; `held` was applied in the period that ended here."""
        begin = self._present or state
        row = (begin.vx_mps, begin.vy_mps, begin.yaw_rate_radps, *held)
        if self._present is None:
            self._rows[:] = row
        else:
            self._rows[:-1] = self._rows[1:]
            self._rows[-1] = row
        self._present = state

    def forget(self) -> None:
        """Discard all rows: the next state does not follow on the last one."""
        self._present = None
