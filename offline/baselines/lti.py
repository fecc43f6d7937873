"""A fair linear rival: one linear model with offset, by least squares, for all speeds and roads.

It starts from the measured state, has a constant term, and is fitted to every transition of the
training part at once. It ships as a bundle whose lift is the identity, so the controller drives
with it through the same code as with any other model.
"""

import numpy as np

from offline.baselines.least_squares import fit_one_step
from offline.baselines.linear_model import LinearModel
from offline.baselines.onnx_file import identity_encoder
from offline.dataset import Dataset
from offline.provenance import describe_training
from rt_controller.contract.artifact import Bundle, Lift, LiftSample


def fit_linear(dataset: Dataset) -> LinearModel:
    """The best one-step linear model of the training part."""
    return fit_one_step(dataset.select("train"), dataset.schema, dataset.roles)


def as_bundle(name: str, model: LinearModel, dataset: Dataset, selftest: LiftSample) -> Bundle:
    """A linear model of the states as a bundle whose lift is the identity."""
    b = len(selftest.x)
    findings = {finding.name: finding.value for finding in model.findings()}
    return Bundle(
        name=name,
        schema=dataset.schema,
        A=model.A,
        B_uc=model.B_uc,
        B_uw=model.B_uw,
        c=model.c,
        lift=Lift(),
        encoder_onnx=identity_encoder(len(model.A)),
        selftest=LiftSample(selftest.x, selftest.w, np.zeros((b, 0, 0))),
        selftest_psi=selftest.x.copy(),
        training=describe_training({"kind": name, **findings}, dataset.origin),
        data_sha256=dataset.sha256,
    )
