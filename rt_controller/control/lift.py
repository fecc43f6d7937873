"""psi = [x; phi(x, w, history)]: the encoder of a bundle, run by onnxruntime in fixed memory."""

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rt_controller.contract.bundle import Array, Bundle
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.schema import N_STATES
from rt_controller.contract.signals import VehicleState
from rt_controller.control.history import Rows

# onnxruntime starts a telemetry thread on import unless it is told not to.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

import onnxruntime as ort

SELFTEST_TOLERANCE = 1e-4
"""in units of each observable's spread. Export asks for 1e-5 on one machine; here another
processor may sum in another order, which is no fault of the model"""


class Encoder:
    """The lift of one bundle, for one instant a tick or a batch of states.

    Raises:
        ArtifactError: the file is not an ONNX model, takes or gives other tensors than the bundle
            says, or does not reproduce its self-test pairs.

    Paper: eq. (7).
    """

    def __init__(self, bundle: Bundle) -> None:
        """`bundle` is one of the car's signals (`fitness.require_drivable`)."""
        shapes = _shapes_shown(bundle)
        self._session = _open(bundle, shapes)
        self._shown = {
            name: np.zeros((1, *shape), dtype=np.float32) for name, shape in shapes.items()
        }
        self._x = self._shown["x"]
        self._w = self._shown.get("w", np.zeros((1, 1), dtype=np.float32))
        self.history: Rows | None = self._shown["history"][0] if "history" in shapes else None
        """(H, h), what `lift` shows of the past: to be written in place"""
        n = bundle.n_observables
        self._psi = np.zeros((1, n), dtype=np.float32)
        self.psi = np.zeros(n)
        """(n,), the last lifted state; overwritten by the next"""
        # An OrtValue made from a numpy array aliases its memory: writing in place is feeding it.
        self._binding = self._session.io_binding()
        for name, memory in self._shown.items():
            self._binding.bind_ortvalue_input(name, ort.OrtValue.ortvalue_from_numpy(memory))
        self._binding.bind_ortvalue_output("psi", ort.OrtValue.ortvalue_from_numpy(self._psi))
        self._check(bundle)

    def lift(self, state: VehicleState, curvature_per_m: float) -> Array:
        """psi (n,) now, with `history` as it stands; the states keep their double precision."""
        self._x[0] = state
        self._w[0, 0] = curvature_per_m
        self._session.run_with_iobinding(self._binding)
        self.psi[:] = self._psi[0]
        self.psi[:N_STATES] = state
        return self.psi

    def lift_batch(self, states: Array, curvature_per_m: float) -> Array:
        """psi (batch, n) of states (batch, 6), all on one road; for a lift without history."""
        shown = {"x": states.astype(np.float32)}
        if "w" in self._shown:
            shown["w"] = np.full((len(states), 1), curvature_per_m, dtype=np.float32)
        (psi,) = self._session.run(["psi"], shown)
        lifted: Array = psi.astype(np.float64)
        lifted[:, :N_STATES] = states
        return lifted

    def _check(self, bundle: Bundle) -> None:
        try:
            instants = zip(*bundle.selftest, strict=True)
            found = np.stack([self._lift_instant(*instant) for instant in instants])
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

    def _lift_instant(self, x: Array, w: Array, history: Array) -> Array:
        if self.history is not None:
            self.history[:] = history
        return self.lift(VehicleState(*x), w[0]).copy()


def _shapes_shown(bundle: Bundle) -> dict[str, tuple[int, ...]]:
    """The shape of each input of the encoder, without the batch."""
    lift, schema = bundle.lift, bundle.schema
    shapes = {
        "x": (len(schema.states),),
        "w": (len(schema.exogenous),),
        "history": (lift.history_steps, len(lift.history_fields)),
    }
    return {name: shapes[name] for name in lift.inputs}


def _open(bundle: Bundle, shapes: Mapping[str, tuple[int, ...]]) -> ort.InferenceSession:
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
    _check_tensors("input", session.get_inputs(), shapes)
    _check_tensors("output", session.get_outputs(), {"psi": (bundle.n_observables,)})
    return session


def _check_tensors(
    what: str, found: Sequence[ort.NodeArg], expected: Mapping[str, tuple[int, ...]]
) -> None:
    """Return if there are these tensors and no others: float (any batch, *shape)."""
    if len(found) == len(expected) and all(
        tensor.name in expected and _is_float_batch(tensor, expected[tensor.name])
        for tensor in found
    ):
        return
    wanted = ", ".join(
        f"{name}: tensor(float) {['batch', *shape]}" for name, shape in expected.items()
    )
    listed = ", ".join(f"{tensor.name}: {tensor.type} {tensor.shape}" for tensor in found)
    raise ArtifactError(
        f"encoder.onnx: expected {len(expected)} {what} {wanted} for any batch, found "
        f"{listed or 'none'}. The encoder is not the one this bundle describes: run "
        f"offline-export of the same version."
    )


def _is_float_batch(tensor: ort.NodeArg, shape: tuple[int, ...]) -> bool:
    found: list[Any] = tensor.shape
    return (
        tensor.type == "tensor(float)"
        and len(found) == 1 + len(shape)
        and not isinstance(found[0], int)
        and tuple(found[1:]) == shape
    )


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), type(error).__name__)
