"""One step of training, against a plain transcription of the paper's loss.

The transcription encodes every target and leaves the gradient of the roll-out to automatic
differentiation, as the equations read. The same batch, the same model, one thread.
"""

import numpy as np
import pytest
import torch
from torch import Tensor

from offline.config import PRESETS, TrainingConfig
from offline.data.sampling import Batch
from offline.data.signals import VEHICLE_ROLES
from offline.model.losses import draw_times, total_loss
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from offline.model.stability import growth_excess
from rt_controller.contract.signals import VEHICLE

SIZES = sizes_of(VEHICLE, VEHICLE_ROLES)
BATCH, STEPS = 128, 80
SAMPLED_TARGETS = 8


@pytest.fixture(autouse=True)
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def a_model(preset: str) -> tuple[MdkNet, TrainingConfig]:
    torch.manual_seed(0)
    config = PRESETS[preset]
    return MdkNet(config, SIZES), config


def a_batch(history: int) -> Batch:
    rng = np.random.default_rng(0)
    shapes = (
        (STEPS + 1, BATCH, 6),
        (STEPS, BATCH, 3),
        (STEPS, BATCH, 1),
        (history + STEPS, BATCH, 6),
        (1, BATCH, 1),
    )
    return Batch(*(torch.from_numpy(rng.normal(size=shape)).float() for shape in shapes))


def transcribed_loss(model: MdkNet, config: TrainingConfig, batch: Batch) -> Tensor:
    """Eqs. (9)-(13) with loops over the steps of the equations."""
    A, B = model.operator()
    u = torch.cat([batch.u, batch.w], dim=-1)
    psi = [model.lift(batch.at(torch.tensor([k])))[0] for k in range(STEPS + 1)]
    single_step = sum(
        (psi[i + 1] - psi[i] @ A.t() - u[i] @ B.t()).square().sum(-1).mean() for i in range(STEPS)
    )
    predicted, multi_step, weight_sum = psi[0], 0.0, 0.0
    for i in range(1, STEPS + 1):
        predicted = predicted @ A.t() + u[i - 1] @ B.t()
        weight = config.forgetting**i
        multi_step = multi_step + weight * (psi[i] - predicted).square().sum(-1).mean()
        weight_sum += weight
    theta = sum(p.square().sum() for p in model.encoders.parameters())
    prior = torch.eye(len(A))
    regularisation = config.decay_encoder * theta + config.decay_operator * (
        (A - prior).square().sum() + B.square().sum()
    )
    return (
        config.weight_single_step * single_step / STEPS
        + config.weight_multi_step * multi_step / weight_sum
        + config.weight_stability * growth_excess(A)
        + config.weight_regularisation * regularisation
    )


def step_of(model: MdkNet, loss):
    """A gradient step on whatever `loss` returns."""
    optimizer = torch.optim.Adam(model.parameters())

    def step() -> None:
        optimizer.zero_grad()
        loss().backward()
        optimizer.step()

    return step


def test_plain_transcription_of_the_papers_loss(benchmark):
    model, config = a_model("paper")
    batch = a_batch(0)
    with torch.no_grad():
        ours, plain = total_loss(model, config, batch).total, transcribed_loss(model, config, batch)
    assert torch.isclose(ours, plain, rtol=1e-4)
    benchmark(step_of(model, lambda: transcribed_loss(model, config, batch)))


def test_preset_paper_every_target_encoded(benchmark):
    model, config = a_model("paper")
    batch = a_batch(0)
    benchmark(step_of(model, lambda: total_loss(model, config, batch).total))


def test_preset_paper_with_sampled_targets(benchmark):
    model, config = a_model("paper")
    batch, rng = a_batch(0), torch.Generator().manual_seed(0)

    def loss() -> Tensor:
        return total_loss(model, config, batch, draw_times(STEPS, SAMPLED_TARGETS, rng)).total

    benchmark(step_of(model, loss))


@pytest.mark.parametrize("preset", ["linear", "recommended"])
def test_horizon_objective(benchmark, preset):
    """The recommended preset's own batch is twice as large; here all have 128 trajectories."""
    model, config = a_model(preset)
    batch = a_batch(config.history_steps)
    benchmark(step_of(model, lambda: total_loss(model, config, batch).total))
