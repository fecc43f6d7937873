"""From a checkpoint to a checked bundle in physical units."""

import torch

from offline.config import TrainingConfig
from offline.data.dataset import Dataset
from offline.data.manifest import describe_training
from offline.data.signals import past_names, signal_range
from offline.data.validity import validity_of
from offline.model.encoder import MakeEncoder
from offline.model.export_checks import ExportFigures, check_export, limits_beside, limits_of
from offline.model.physical_units import (
    PhysicalEncoder,
    choose_selftest,
    physical_matrices,
    tensors_of,
    to_onnx,
)
from offline.training.run import Checkpoint, restore_model
from rt_controller.contract.errors import DatasetError
from rt_controller.model.bundle import Bundle
from rt_controller.model.lift import Lift


def export_checkpoint(
    checkpoint: Checkpoint,
    dataset: Dataset,
    encoder: MakeEncoder | None = None,
    first_model: Bundle | None = None,
) -> tuple[Bundle, ExportFigures]:
    """The bundle of a checkpoint, and what its checks found; `encoder` as of `train`.

    `first_model` is the one of --init: it is a measure of the stability.

    Raises:
        ArtifactError: the model does not pass `check_export`, or has another encoder.
        DatasetError: the model was trained on another data set.
    """
    if dataset.sha256 != checkpoint.data_sha256:
        raise DatasetError(
            f"export expects the data set that the model was trained on, "
            f"{checkpoint.data_sha256:.16}…, found {dataset.sha256:.16}…. Name its folder with "
            f"--data."
        )
    config, scaling = checkpoint.config, checkpoint.scaling
    model = restore_model(checkpoint, dataset.schema, dataset.roles, encoder)
    physical = PhysicalEncoder(model, scaling).eval()
    fields = past_names(dataset.schema, dataset.roles) if model.history_steps else ()
    lift = Lift(model.reads_exogenous, model.history_steps, fields)
    selftest = choose_selftest(dataset, lift)
    with torch.no_grad():
        selftest_psi = physical(*tensors_of(selftest, lift)).double().numpy()
    selftest_psi[:, : model.sizes.states] = selftest.x
    # Without the widths of the perceptrons, --init refuses the bundle.
    unknown = set() if encoder is None else {"hidden"}
    settings = {**config.model_dump(mode="json", exclude=unknown), "step": checkpoint.step}
    if encoder is not None:
        settings["encoder"] = "a module passed from Python"
    is_default = config.preset == TrainingConfig().preset
    bundle = Bundle(
        name="mdk-net" if is_default else f"mdk-net-{config.preset}",
        schema=dataset.schema,
        car=dataset.car,
        **physical_matrices(model, scaling)._asdict(),
        lift=lift,
        encoder_onnx=to_onnx(physical, lift, selftest),
        selftest=selftest,
        selftest_psi=selftest_psi,
        training=describe_training(settings, dataset.origin),
        data_sha256=dataset.sha256,
        signal_range=signal_range(dataset.select("train"), dataset.schema),
        validity=validity_of(dataset, config.windows == "all" and config.near_roads > 0.0),
    )
    limits = limits_of(config)
    if first_model is not None:
        limits = limits_beside(first_model, bundle, limits)
    return bundle, check_export(bundle, dataset, limits)
