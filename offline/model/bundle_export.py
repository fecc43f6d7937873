"""Encoders as ONNX, and the instants of the self-test."""

import logging
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import onnx
import torch
from torch import nn

from offline.data.dataset import Dataset
from offline.data.signals import last_rows
from rt_controller.contract.model.lift import Lift, LiftSample

SELFTEST_STATES = 32


def choose_selftest(dataset: Dataset, lift: Lift) -> LiftSample:
    """Encoder inputs at 32 instants spread evenly over the test part."""
    test = dataset.select("test")
    rows = np.linspace(0, len(test.episode) - 1, SELFTEST_STATES).astype(int)
    chosen = test.take(rows)
    history = last_rows(chosen.past, lift.history_steps)[..., : len(lift.history_fields)]
    return LiftSample(
        chosen.x[:, 0].astype(np.float64),
        chosen.w[:, 0].astype(np.float64),
        history.astype(np.float64),
    )


def to_onnx(encoder: nn.Module, lift: Lift, sample: LiftSample) -> bytes:
    """The encoder as ONNX: the inputs of `lift` -> "psi" (batch, n), float32, any batch size."""
    example = tuple(tensor[:2] for tensor in tensors_of(sample, lift))
    batch = torch.export.Dim("batch")
    shapes: tuple[object, ...] = ({0: batch},)
    if len(example) > 1:
        shapes += (tuple({0: batch} for _ in example[1:]),)
    with tempfile.TemporaryDirectory() as folder, _quiet_exporter():
        path = Path(folder) / "encoder.onnx"
        torch.onnx.export(
            encoder,
            example,
            str(path),
            input_names=list(lift.inputs),
            output_names=["psi"],
            dynamic_shapes=shapes,
            dynamo=True,
            external_data=False,
            verbose=False,
        )
        serialised: bytes = _without_traces(onnx.load(path)).SerializeToString()
    return serialised


def tensors_of(sample: LiftSample, lift: Lift) -> list[torch.Tensor]:
    """The encoder's inputs in float32, in the order of `lift.inputs`."""
    return [torch.from_numpy(getattr(sample, name).astype(np.float32)) for name in lift.inputs]


def _without_traces(model: onnx.ModelProto) -> onnx.ModelProto:
    """The model without the exporter's metadata: stack traces with paths of this machine."""
    graph = model.graph
    values = (*graph.value_info, *graph.initializer, *graph.input, *graph.output)
    for part in (model, graph, *graph.node, *values):
        del part.metadata_props[:]
        part.doc_string = ""
    return model


@contextmanager
def _quiet_exporter() -> Iterator[None]:
    """Suppress the exporter's messages on unused packages and its own deprecations."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)
