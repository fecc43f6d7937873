"""A step leaves nothing behind: what runs for hours may not grow."""

import gc
import sys

from scripted_vehicle import build_rig

from rt_controller.config import MpcSettings
from rt_controller.contract.artifact import load_bundle
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import Mode
from rt_controller.control.mpc import Mpc
from rt_controller.session import shipped_model

STEPS = 20_000
GROWTH_BLOCKS = 200
"""caches of the interpreter fill up a little; one block a step would be a hundred times that"""


def test_twenty_thousand_steps_keep_no_memory() -> None:
    settings = MpcSettings()
    bundle = load_bundle(shipped_model())
    with build_rig(Mpc(bundle, settings.horizon, settings.cost(), INPUT_LIMITS)) as rig:
        step_and_prepare(rig, 500)
        gc.collect()
        before = sys.getallocatedblocks()
        step_and_prepare(rig, STEPS)
        gc.collect()
        grown = sys.getallocatedblocks() - before
        assert rig.step.outcome.mode is Mode.NOMINAL
    assert grown < GROWTH_BLOCKS


def step_and_prepare(rig, steps: int) -> None:
    for _ in range(steps):
        rig.tick()
        rig.step.prepare()
