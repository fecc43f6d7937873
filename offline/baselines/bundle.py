"""Fitted rivals as bundles, so that the controller drives with them as with any other model."""

from offline.baselines import lifted_bundle, lti
from offline.baselines.lifted_model import LiftedModel
from offline.baselines.linear_model import LinearModel
from offline.baselines.shelf import FittedRival
from offline.dataset import Dataset
from rt_controller.contract.artifact import Bundle, LiftSample
from rt_controller.contract.errors import ArtifactError


def bundle_of(name: str, rival: FittedRival, dataset: Dataset, sample: LiftSample) -> Bundle:
    """The rival of that name, fitted to these data, as a bundle.

    `sample` are instants to keep for its self-test, with the whole past that windows have.

    Raises:
        ArtifactError: a convex controller cannot drive with such a model.
    """
    if isinstance(rival, LinearModel):
        return lti.as_bundle(name, rival, dataset, sample)
    if isinstance(rival, LiftedModel):
        return lifted_bundle.as_bundle(name, rival, dataset, sample)
    raise ArtifactError(
        f"{name}: expected a model that is linear, or bilinear, in what its lift makes of the "
        f"state, found another kind: it cannot be planned with as a convex QP."
    )
