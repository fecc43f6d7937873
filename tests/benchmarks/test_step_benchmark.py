"""A whole step, frames in to frames out: back to back, and at its true spacing with cold caches."""

import time
from collections.abc import Iterator

import pytest
from scripted_vehicle import Rig, build_rig

from rt_controller.config import MpcSettings
from rt_controller.contract.artifact import load_bundle
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import Mode
from rt_controller.control.mpc import Mpc
from rt_controller.realtime.clock import sleep_until
from rt_controller.session import shipped_model

PERIOD_NS = 25_000_000


@pytest.fixture(params=["mdk-net", "mdk-net-paper", "lti"])
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    settings = MpcSettings()
    bundle = load_bundle(shipped_model(request.param))
    with build_rig(Mpc(bundle, settings.horizon, settings.cost(), INPUT_LIMITS)) as built:
        built.tick(20)
        yield built


def test_step_back_to_back(benchmark, rig: Rig) -> None:
    def hear() -> None:
        rig.heard.drain(rig.vehicle_bus, 0)
        rig.clock.wait()

    outcome = benchmark.pedantic(rig.step.run, setup=hear, rounds=400)
    assert outcome.mode is Mode.NOMINAL


def test_step_every_25_ms(benchmark, rig: Rig) -> None:
    due_ns = time.monotonic_ns()

    def hear_and_sleep() -> None:
        nonlocal due_ns
        rig.heard.drain(rig.vehicle_bus, 0)
        rig.clock.wait()
        due_ns += PERIOD_NS
        sleep_until(due_ns)

    outcome = benchmark.pedantic(rig.step.run, setup=hear_and_sleep, rounds=120)
    assert outcome.mode is Mode.NOMINAL
