"""The start of a training at the model of a bundle, in place of random weights.

A car of one's own often has few data: a model that begins as that of another car needs a fraction
of the steps.
"""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor

from offline.config import TrainingConfig
from offline.data.dataset import Dataset
from offline.data.signals import Scaling, fit_scaling, past_columns, past_names
from offline.model.encoder import Encoder
from offline.model.network import MdkNet
from offline.model.physical_units import scaling_of_lift
from offline.training.run import Checkpoint
from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ArtifactError, ConfigError
from rt_controller.contract.signals import MOTION
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import no_gains

STRUCTURE = (
    "activation",
    "hidden",
    "latents",
    "constant_observable",
    "lift_exogenous",
    "products",
    "history_steps",
    "separate_motion",
    "symmetry",
    "bilinear_rank",
    "saturating_gains",
    "drift_rank",
    "bilinear_follows",
)
"""settings that determine the shapes of a model"""


def with_structure_of(
    bundle: Bundle, config: TrainingConfig, explicit: dict[str, Any]
) -> TrainingConfig:
    """The configuration with the structure of the bundle's model, and with whole roll-outs.

    Raises:
        ConfigError: the explicit settings contradict the structure, or the bundle has none.
    """
    trained = json.loads(bundle.training)
    if not set(STRUCTURE) <= set(trained):
        raise ConfigError(
            f"--init: expected a bundle of a network that this version trained, found "
            f"{bundle.name!r}, whose configuration lacks "
            f"{', '.join(name for name in STRUCTURE if name not in trained)}. Name another bundle, "
            f"or train without --init."
        )
    is_symmetric = any(name.endswith("latent_signs") for name in _weights(bundle))
    if trained["symmetry"] == "exact" and not is_symmetric:  # of a car that has no symmetry
        trained["symmetry"] = "none"
    known = TrainingConfig.model_validate({name: trained[name] for name in STRUCTURE})
    structure = {name: getattr(known, name) for name in STRUCTURE}
    for name, value in structure.items():
        if explicit.get(name, value) != value:
            raise ConfigError(
                f"--{name.replace('_', '-')}: expected {value}, as the model of --init has it, "
                f"found {explicit[name]}. Leave out one of them."
            )
    whole = {} if "horizon_start" in explicit else {"horizon_start": None}
    return config.model_copy(update={**structure, **whole})


def choose_scaling(
    dataset: Dataset, first_model: Bundle | None, resume_from: Checkpoint | None
) -> Scaling:
    """That of the resumed run, otherwise of the training part.

    States and exogenous signals are scaled as in the first model, if there is one: the products of
    its encoder are of scaled signals.

    Raises:
        ConfigError: the signals of the data set are not those of the first model.
    """
    if resume_from is not None:
        return resume_from.scaling
    fitted = fit_scaling(dataset.select("train"), dataset.schema, dataset.roles)
    if first_model is None:
        return fitted
    if first_model.schema != dataset.schema:
        expected, found = (
            f"{', '.join((*schema.state_names, *schema.input_names))} every {schema.dt_s:g} s"
            for schema in (dataset.schema, first_model.schema)
        )
        raise ConfigError(
            f"--init: expected a model of the signals of the data set ({expected}), found one of "
            f"others ({found}). Train without --init."
        )
    past = past_names(dataset.schema, dataset.roles)
    if first_model.lift.history_steps and first_model.lift.history_fields != past:
        raise ConfigError(
            f"--init: expected a model whose history has the signals of the data set "
            f"({', '.join(past)}), found one with {', '.join(first_model.lift.history_fields)}. "
            f"Write past = {list(first_model.lift.history_fields)} in [roles] of the mapping and "
            f"import again, or train without --init."
        )
    weights = _weights(first_model)
    scaled = [name for name in weights if name.endswith(".spread")]
    if not scaled:  # an encoder without products
        return fitted
    # The last encoder reads all states, and the exogenous signals if any does; that of a model with
    # an exact path reads the motion only.
    centre, spread = (weights[scaled[-1].replace("spread", each)] for each in ("centre", "spread"))
    n = len(fitted.x_scale) if first_model.movement is None else MOTION.stop
    x_centre, x_scale = fitted.x_centre.copy(), fitted.x_scale.copy()
    x_centre[:n], x_scale[:n] = centre[:n], spread[:n]
    states, inputs = past_columns(dataset.schema, dataset.roles)
    return replace(
        fitted,
        x_centre=x_centre,
        x_scale=x_scale,
        w_scale=spread[n:].astype(float) if len(spread) > n else fitted.w_scale,
        past_centre=np.concatenate([x_centre[states], np.zeros(len(inputs))]),
        past_scale=np.concatenate([x_scale[states], fitted.u_scale[inputs]]),
    )


def take_weights(model: MdkNet, bundle: Bundle, scaling: Scaling) -> None:
    """Give a model the weights of a bundle of the same structure, for signals so scaled.

    Raises:
        ArtifactError: the encoder in the bundle has other layers.
    """
    weights = _weights(bundle)
    if any(name.endswith("own_spread") for name in weights):
        weights = {}  # those of an encoder of its own are for inputs scaled in another way
    centre, spread = scaling_of_lift(model, scaling)
    with torch.no_grad():
        for i, encoder in enumerate(model.encoders):
            assert isinstance(encoder, Encoder)
            columns = encoder.columns.cpu().numpy()
            _take_encoder(
                encoder, f"encoders.{i}.encoder.", weights, centre[columns], spread[columns]
            )
        _take_operator(model, bundle, scaling)


def _take_encoder(
    encoder: Encoder, prefix: str, weights: dict[str, Array], centre: Array, spread: Array
) -> None:
    found = {
        name: weights[prefix + name].astype(float)
        for name in encoder.state_dict()
        if prefix + name in weights
    }
    if (first := "layers.0.weight") in found:
        found["layers.0.bias"] = found["layers.0.bias"] + found[first] @ centre
        found[first] = found[first] * spread
    for name, parameter in encoder.named_parameters():
        rows = found.get(name, np.empty(0))[: len(parameter)]  # without the constant
        if rows.shape != tuple(parameter.shape):
            raise ArtifactError(
                f"--init: expected {prefix}{name} of shape {tuple(parameter.shape)} in "
                f"encoder.onnx, found {rows.shape or 'none'}. Take a bundle that this version "
                f"exported, without an encoder of its own."
            )
        parameter.copy_(_float(rows))


def _take_operator(model: MdkNet, bundle: Bundle, scaling: Scaling) -> None:
    """The inverse of `physical_matrices`; entries that are not learned stay as they are."""
    s = np.ones(len(bundle.A))
    s[: len(scaling.x_scale)] = scaling.x_scale
    A = bundle.A / s[:, None] * s
    B = np.hstack([bundle.B_uc * scaling.u_scale, bundle.B_uw * scaling.w_scale]) / s[:, None]
    gains = bundle.gains or no_gains(len(s))
    N = gains.N * gains.factors(scaling.u_scale, scaling.w_scale) / s[:, None]
    rows = len(model.A_rows)
    model.A_rows.copy_(_float(A[:rows]))
    model.B_rows.copy_(_float(B[:rows]))
    model.N_rows.copy_(_float(N[:rows]))
    model.S.copy_(_float(gains.S * s))
    if model.path is not None and bundle.movement is not None:
        model.path.take(_float(bundle.movement.S * s))


def _weights(bundle: Bundle) -> dict[str, Array]:
    """Named constants of the encoder in ONNX."""
    graph = onnx.load_model_from_string(bundle.encoder_onnx).graph
    return {each.name: numpy_helper.to_array(each) for each in graph.initializer}


def _float(array: Array) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array)).float()
