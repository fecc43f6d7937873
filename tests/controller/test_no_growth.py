"""Steps allocate no memory that they keep."""

import gc
import sys
from itertools import pairwise

import pytest
from scripted_vehicle import Rig, build_rig

from rt_controller.config import MpcSettings
from rt_controller.contract.signals import Mode
from rt_controller.control.mpc import Mpc
from rt_controller.model.artifact import load_bundle, shipped_model

WARM_UP_STEPS = 300
"""in which most of the caches of the interpreter fill"""


@pytest.mark.parametrize(
    ("windows", "steps", "max_grown_blocks"),
    [(6, 150, 13), pytest.param(5, 4_000, 40, marks=pytest.mark.nightly)],
)
def test_steps_keep_no_memory(windows: int, steps: int, max_grown_blocks: int) -> None:
    """Memory that each step keeps grows in every window; a cache grows in some of them only."""
    settings = MpcSettings()
    bundle = load_bundle(shipped_model())
    blocks = []
    with build_rig(Mpc(bundle, settings.horizon, settings.cost())) as rig:
        run_steps(rig, WARM_UP_STEPS)
        for _ in range(windows + 1):
            gc.collect()
            blocks.append(sys.getallocatedblocks())
            run_steps(rig, steps)
        assert rig.step.last.mode is Mode.NOMINAL
    assert min(after - before for before, after in pairwise(blocks)) < max_grown_blocks


def run_steps(rig: Rig, steps: int) -> None:
    for _ in range(steps):
        rig.tick()
        rig.step.update_matrices()
        rig.step.read_ahead()
        rig.step.warm_up()
