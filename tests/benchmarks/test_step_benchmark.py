"""Time of a whole step, frames in to frames out: in a row, and once a period with cold caches."""

import time
from collections.abc import Iterator

import pytest
from scripted_vehicle import Rig, build_rig

from rt_controller.config import MpcSettings
from rt_controller.contract.signals import Mode
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.control.mpc import Mpc
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.realtime.clock import sleep_until


@pytest.fixture(params=["mdk-net", "mdk-net-paper", "lti"])
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    settings = MpcSettings()
    bundle = load_bundle(shipped_model(request.param))
    with build_rig(Mpc(bundle, settings.horizon, settings.cost())) as built:
        built.tick(20)
        yield built


def test_steps_in_a_row(benchmark, rig: Rig) -> None:
    def receive() -> None:
        rig.received.drain(rig.vehicle_bus, 0)
        rig.clock.wait()

    result = benchmark.pedantic(rig.step.run, setup=receive, rounds=400)
    assert result.mode is Mode.NOMINAL


def test_step_every_period(benchmark, rig: Rig) -> None:
    due_ns = time.monotonic_ns()

    def receive_and_sleep() -> None:
        nonlocal due_ns
        rig.received.drain(rig.vehicle_bus, 0)
        rig.clock.wait()
        due_ns += PERIOD_NS
        sleep_until(due_ns)

    result = benchmark.pedantic(rig.step.run, setup=receive_and_sleep, rounds=120)
    assert result.mode is Mode.NOMINAL
