"""Steps allocate no memory that they keep."""

import gc
import sys

import pytest
from scripted_vehicle import Rig, build_rig

from rt_controller.config import MpcSettings
from rt_controller.contract.artifact import load_bundle, shipped_model
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import Mode
from rt_controller.control.mpc import Mpc

WARM_UP_BATCHES = 2
BATCHES = 4
MAX_GROWN_BLOCKS = 60
"""of the best batch: the caches of the interpreter grow a little in the first 600 steps, by at most
40 blocks a batch of 100; a leak of one block a step is 100 blocks and more"""


@pytest.mark.parametrize("steps", [100, pytest.param(2_000, marks=pytest.mark.nightly)])
def test_steps_keep_no_memory(steps: int) -> None:
    """A leak grows in every batch, so the smallest growth shows it."""
    settings = MpcSettings()
    bundle = load_bundle(shipped_model())
    with build_rig(Mpc(bundle, settings.horizon, settings.cost(), INPUT_LIMITS)) as rig:
        grown_blocks = [growth_of(rig, steps) for _ in range(WARM_UP_BATCHES + BATCHES)]
        assert rig.step.result.mode is Mode.NOMINAL
    assert min(grown_blocks[WARM_UP_BATCHES:]) < MAX_GROWN_BLOCKS


def growth_of(rig: Rig, steps: int) -> int:
    gc.collect()
    before = sys.getallocatedblocks()
    for _ in range(steps):
        rig.tick()
        rig.step.update_matrices()
        rig.step.read_ahead()
        rig.step.warm_up()
    gc.collect()
    return sys.getallocatedblocks() - before
