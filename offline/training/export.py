"""From a checkpoint to a checked bundle in physical units."""

import torch

from offline.config import TrainingConfig
from offline.data.dataset import Dataset
from offline.data.manifest import describe_training
from offline.data.signals import Roles, past_names, signal_range
from offline.model.bundle_export import choose_selftest, tensors_of, to_onnx
from offline.model.export_checks import ExportFigures, check_export, limits_of
from offline.model.network import MdkNet, sizes_of
from offline.model.physical_units import PhysicalEncoder, physical_matrices
from offline.training.checkpoint import Checkpoint, load_weights
from rt_controller.contract.errors import DatasetError
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.lift import Lift
from rt_controller.contract.schema import Schema


def restore_model(checkpoint: Checkpoint, schema: Schema, roles: Roles) -> MdkNet:
    """The model of a checkpoint, in evaluation mode."""
    model = MdkNet(checkpoint.config, sizes_of(schema, roles))
    load_weights(model, checkpoint)
    return model.eval()


def export_checkpoint(checkpoint: Checkpoint, dataset: Dataset) -> tuple[Bundle, ExportFigures]:
    """The bundle of a checkpoint, and what its checks found.

    Raises:
        ArtifactError: the model does not pass `check_export`.
        DatasetError: the model was trained on another data set.
    """
    if dataset.sha256 != checkpoint.data_sha256:
        raise DatasetError(
            f"export expects the data set that the model was trained on, "
            f"{checkpoint.data_sha256:.16}…, found {dataset.sha256:.16}…. Name its folder with "
            f"--data."
        )
    config, scaling = checkpoint.config, checkpoint.scaling
    model = restore_model(checkpoint, dataset.schema, dataset.roles)
    encoder = PhysicalEncoder(model, scaling).eval()
    lift = _lift_of(model, dataset)
    selftest = choose_selftest(dataset, lift)
    with torch.no_grad():
        selftest_psi = encoder(*tensors_of(selftest, lift)).double().numpy()
    selftest_psi[:, : model.sizes.states] = selftest.x
    settings = {**config.model_dump(mode="json"), "step": checkpoint.step}
    is_default = config.preset == TrainingConfig().preset
    bundle = Bundle(
        name="mdk-net" if is_default else f"mdk-net-{config.preset}",
        schema=dataset.schema,
        geometry=dataset.geometry,
        **physical_matrices(model, scaling)._asdict(),
        lift=lift,
        encoder_onnx=to_onnx(encoder, lift, selftest),
        selftest=selftest,
        selftest_psi=selftest_psi,
        training=describe_training(settings, dataset.origin),
        data_sha256=dataset.sha256,
        signal_range=signal_range(dataset.select("train"), dataset.schema),
    )
    return bundle, check_export(bundle, dataset, limits_of(config))


def _lift_of(model: MdkNet, dataset: Dataset) -> Lift:
    fields = past_names(dataset.schema, dataset.roles) if model.history_steps else ()
    return Lift(model.reads_exogenous, model.history_steps, fields)
