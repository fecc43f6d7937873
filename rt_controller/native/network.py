"""The network of an encoder, read from its ONNX file: weights, activation and symmetry."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import MOTION, N_STATES
from rt_controller.model.bundle import Bundle
from rt_controller.model.lift import LiftSample

Numbers = NDArray[np.float32]
ACTIVATIONS = ("Sigmoid", "Relu")
"""operators of SiLU and ReLU, in the order of `mdk_activation`"""
LARGEST_ERROR = 1e-4
"""of a lifted state of the self-test, in units of `Bundle.parity_error`"""
_GRAPH, _NODE, _INITIALIZER, _OPERATOR = 7, 1, 5, 4
_DIMENSIONS, _TYPE, _NAME, _RAW = 1, 2, 8, 9
"""field numbers of the messages of ONNX"""
_FLOAT = 1
"""the type of a tensor"""
_VARINT, _LENGTH, _FIXED_32 = 0, 2, 5
"""kinds of a field of protobuf; any other one has 8 bytes"""


@dataclass(frozen=True)
class Layer:
    """As `mdk_layer`."""

    inputs: int
    outputs: int
    weights: Numbers
    """(outputs, inputs)"""
    biases: Numbers


@dataclass(frozen=True)
class Network:
    """As `mdk_encoder`, its fields in their order."""

    layers: int = 0
    layer: tuple[Layer, ...] | None = None
    activation: int = 0
    latents: int = 0
    present: int = 0
    history: int = 0
    columns: NDArray[np.int32] | None = None
    products: Numbers | None = None
    centre: Numbers | None = None
    spread: Numbers | None = None
    signs: Numbers | None = None
    latent_signs: Numbers | None = None

    def lift(self, sample: LiftSample) -> Array:
        """psi (b, n) of the inputs of an encoder."""
        if self.layer is None or self.columns is None:
            return sample.x
        now = np.hstack([sample.x, sample.w])[:, self.columns]
        seen = np.hstack([now, sample.history.reshape(len(now), -1)])
        latents = self._function(seen)
        if self.signs is not None and self.latent_signs is not None:
            mirrored = self._function(self.signs.astype(np.float64) * seen.astype(np.float64))
            latents = 0.5 * (latents + self.latent_signs * mirrored)
        return np.hstack([sample.x, latents])

    def _function(self, seen: Array) -> Array:
        layers, found = self.layer or (), seen
        for k, layer in enumerate(layers):
            found = found @ layer.weights.T + layer.biases
            if k + 1 < len(layers):
                is_silu = self.activation == 0
                found = found / (1.0 + np.exp(-found)) if is_silu else np.maximum(found, 0.0)
        if self.products is not None and self.centre is not None and self.spread is not None:
            scaled = (seen[:, : self.present] - self.centre) / self.spread
            first, second = np.triu_indices(self.present)
            found = found + (scaled[:, first] * scaled[:, second]) @ self.products.T
        return found


def network_of(bundle: Bundle) -> Network:
    """The network of a bundle of a car.

    Raises:
        ArtifactError: the encoder is not a network that this version trained.
    """
    network = Network()
    if bundle.n_observables > N_STATES:
        network = _read(bundle)
    error = np.inf
    with suppress(ValueError):  # other shapes
        error = bundle.parity_error(network.lift(bundle.selftest))
    if not error < LARGEST_ERROR:
        raise ArtifactError(
            f"The model {bundle.name!r}: expected an encoder that is a multilayer perceptron as "
            f"offline-train makes it, found another one. Export a model of offline-train."
        )
    return network


def _read(bundle: Bundle) -> Network:
    graph = next(content for number, content in _fields(bundle.encoder_onnx) if number == _GRAPH)
    weights = _weights(graph)
    layers: list[Layer] = []
    while f"layers.{2 * len(layers)}.weight" in weights:
        weight, bias = (weights[f"layers.{2 * len(layers)}.{kind}"] for kind in ("weight", "bias"))
        layers.append(Layer(weight.shape[1], weight.shape[0], weight, bias))
    nodes = (dict(_fields(node)) for number, node in _fields(graph) if number == _NODE)
    operators = {node[_OPERATOR].decode() for node in nodes}
    columns = [*range(N_STATES if bundle.movement is None else MOTION.stop)]
    if bundle.lift.sees_exogenous:
        columns.append(N_STATES)
    return Network(
        layers=len(layers),
        layer=tuple(layers),
        activation=next((i for i, each in enumerate(ACTIVATIONS) if each in operators), 0),
        latents=bundle.n_observables - N_STATES,
        present=len(columns),
        history=bundle.lift.history_steps,
        columns=np.array(columns, dtype=np.int32),
        products=weights.get("products.weights.weight"),
        centre=weights.get("centre"),
        spread=weights.get("spread"),
        signs=weights.get("signs"),
        latent_signs=weights.get("latent_signs"),
    )


def _weights(graph: bytes) -> dict[str, Numbers]:
    """The constants of a graph that are of float32, by their names in the encoder."""
    found = {}
    for number, tensor in _fields(graph):
        parts = list(_fields(tensor)) if number == _INITIALIZER else []
        one = dict(parts)
        if one.get(_TYPE) == bytes([_FLOAT]) and _RAW in one:
            shape = [int.from_bytes(size, "little") for kind, size in parts if kind == _DIMENSIONS]
            name = one[_NAME].decode().removeprefix("encoders.0.").removeprefix("encoder.")
            found[name] = np.frombuffer(one[_RAW], dtype="<f4").reshape(shape)
    return found


def _fields(message: bytes) -> Iterator[tuple[int, bytes]]:
    """Number and content of each field of a protobuf message; a whole number as little-endian."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        kind, size = key & 7, 8
        if kind == _VARINT:
            value, at = _varint(message, at)
            yield key >> 3, value.to_bytes(8, "little").rstrip(b"\0") or b"\0"
            continue
        if kind == _LENGTH:
            size, at = _varint(message, at)
        elif kind == _FIXED_32:
            size = 4
        yield key >> 3, message[at : at + size]
        at += size


def _varint(message: bytes, at: int) -> tuple[int, int]:
    """The whole number that begins there, and where it ends."""
    number = shift = 0
    while True:
        number |= (message[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if message[at - 1] < 0x80:
            return number, at
