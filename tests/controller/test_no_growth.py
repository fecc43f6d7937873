"""A step leaves nothing behind: what runs for hours may not grow."""

import gc
import sys

import pytest
from scripted_vehicle import build_rig

from rt_controller.config import MpcSettings
from rt_controller.contract.artifact import load_bundle
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import Mode
from rt_controller.control.mpc import Mpc
from rt_controller.session import shipped_model

GROWTH_BLOCKS = 200
"""caches of the interpreter fill up a little; one block a step would be ten times that and more"""


@pytest.mark.parametrize("steps", [3_000, pytest.param(20_000, marks=pytest.mark.nightly)])
def test_steps_keep_no_memory(steps: int) -> None:
    settings = MpcSettings()
    bundle = load_bundle(shipped_model())
    with build_rig(Mpc(bundle, settings.horizon, settings.cost(), INPUT_LIMITS)) as rig:
        step_and_prepare(rig, 500)
        gc.collect()
        before = sys.getallocatedblocks()
        step_and_prepare(rig, steps)
        gc.collect()
        grown = sys.getallocatedblocks() - before
        assert rig.step.outcome.mode is Mode.NOMINAL
    assert grown < GROWTH_BLOCKS


def step_and_prepare(rig, steps: int) -> None:
    for _ in range(steps):
        rig.tick()
        rig.step.prepare()
        rig.step.rehearse()
