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

WARM_UP_STEPS = 500
"""until the caches of the interpreter have filled"""
MAX_GROWN_BLOCKS = 200


@pytest.mark.parametrize("steps", [3_000, pytest.param(20_000, marks=pytest.mark.nightly)])
def test_steps_keep_no_memory(steps: int) -> None:
    settings = MpcSettings()
    bundle = load_bundle(shipped_model())
    with build_rig(Mpc(bundle, settings.horizon, settings.cost(), INPUT_LIMITS)) as rig:
        run_steps(rig, WARM_UP_STEPS)
        gc.collect()
        before = sys.getallocatedblocks()
        run_steps(rig, steps)
        gc.collect()
        grown_blocks = sys.getallocatedblocks() - before
        assert rig.step.result.mode is Mode.NOMINAL
    assert grown_blocks < MAX_GROWN_BLOCKS


def run_steps(rig: Rig, steps: int) -> None:
    for _ in range(steps):
        rig.tick()
        rig.step.update_matrices()
        rig.step.read_ahead()
        rig.step.warm_up()
