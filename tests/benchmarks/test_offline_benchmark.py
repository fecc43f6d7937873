"""One step of training with the losses of the presets, and one period of the simulated car."""

from math import radians

import numpy as np
import pytest
import torch

from offline.config import PRESETS
from offline.data.sampling import Batch
from offline.data.signals import VEHICLE_ROLES
from offline.model.losses import total_loss
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from rt_controller.contract.signals import VEHICLE, ControlInput
from sim_bridge.plant.library import STEP_S, STEPS_PER_PERIOD, advance, car_record, settle
from sim_bridge.plant.parameters import load_parameters
from sim_bridge.plant.shipped_cars import shipped_cars
from sim_bridge.plant.states import AT

BATCH, STEPS = 128, 80


@pytest.fixture
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.mark.usefixtures("_one_thread")
@pytest.mark.parametrize("preset", ["paper", "linear", "recommended"])
def test_step_of_training(benchmark, preset):
    """The recommended preset's own batch is twice as large; here all have 128 trajectories."""
    torch.manual_seed(0)
    config = PRESETS[preset]
    model = MdkNet(config, sizes_of(VEHICLE, VEHICLE_ROLES))
    optimizer = torch.optim.Adam(model.parameters())
    rng = np.random.default_rng(0)
    rows = ((STEPS + 1, 6), (STEPS, 3), (STEPS, 1), (config.history_steps + STEPS, 6))
    shapes = [(steps, BATCH, width) for steps, width in rows]
    series = (torch.from_numpy(rng.normal(size=shape)).float() for shape in shapes)
    batch = Batch(*series, torch.ones(1, BATCH, 1))

    def step() -> float:
        optimizer.zero_grad()
        loss = total_loss(model, config, batch).total
        loss.backward()
        optimizer.step()
        return loss.item()

    assert np.isfinite(benchmark(step))


@pytest.mark.parametrize("name", shipped_cars())
def test_period_of_driving_through_a_bend(benchmark, name: str) -> None:
    car = load_parameters(name)
    state = settle(22.0, car)
    motion = np.empty((STEPS_PER_PERIOD, 3))
    control = ControlInput(0.15, 0.0, radians(15.0))
    benchmark(advance, state, control, car_record(car), STEPS_PER_PERIOD, STEP_S, motion)
    assert state[AT.yaw_rate_radps] > 0.0


def test_settling_before_a_run(benchmark) -> None:
    car = load_parameters("c_class_150kw_awd")
    state = benchmark(settle, 22.0, car)
    assert state[AT.vx_mps] == 22.0
