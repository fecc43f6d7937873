"""Time of a step, frames in to frames out, and of its parts: coding, plan, QP."""

import time
from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest
from made_frames import CONTROL, PATH, SAMPLE, can_frames
from pytest_benchmark.fixture import BenchmarkFixture
from scripted_vehicle import Rig, build_rig
from virtual_drive import SHORT_LANE_CHANGE

from benchmarks.peers.recording import TIERS, Matrices, Recording, record
from rt_controller.bus.codec import FrameCodec
from rt_controller.bus.messages import CATALOGUE, COMMAND, REFERENCE, STATE, Command, Node
from rt_controller.bus.receive import Inbox, ReceptionCounts
from rt_controller.bus.send import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.config import MpcSettings
from rt_controller.contract.signals import ControlInput, Mode, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_NS
from rt_controller.control.eq14 import CondensedQp
from rt_controller.control.law import LawPlanner
from rt_controller.control.lift import Encoder
from rt_controller.control.mpc import Mpc
from rt_controller.control.program import SolveStatus
from rt_controller.control.warm_start import open_solver
from rt_controller.controllers import BASELINES, open_law
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.bundle import Bundle
from rt_controller.realtime.clock import sleep_until

CODECS = [codec for message in CATALOGUE.messages for codec in message.codecs]
VEHICLE_STATE = VehicleState(22.0, -0.05, 0.06, 0.55, 1.2, 0.07)
WANTED = PathReference(1.3, 0.09, 0.004, -0.0004, 22.2, 0.0)
PREVIOUS = ControlInput(0.15, 0.0, 0.2)
MODELS = ["mdk-net", "mdk-net-paper", "lti"]
"""bilinear, linear with latents, linear"""


@pytest.mark.parametrize("codec", CODECS, ids=lambda codec: codec.name)
def test_encode_check_and_decode(benchmark: BenchmarkFixture, codec: FrameCodec) -> None:
    values = tuple((s.raw_min + s.raw_max) // 2 * s.scale + s.offset for s in codec.signals)

    def code() -> tuple[float, ...]:
        frame = codec.encode(values, 3, 1)
        assert codec.check(frame) >= 0
        return tuple(codec.decode(frame))

    assert benchmark(code) == pytest.approx(values)


def test_receive_state_and_path(benchmark: BenchmarkFixture) -> None:
    """Five frames, checked and assembled; without the bus."""
    rounds = [
        can_frames(STATE, SAMPLE, counter) + can_frames(REFERENCE, PATH, counter)
        for counter in range(128)
    ]
    inbox = Inbox(Node.CONTROLLER)
    tick = 0

    def receive() -> None:
        nonlocal tick
        for message in rounds[tick % 128]:
            inbox.accept(message, tick)
        tick += 1

    benchmark(receive)
    newest = inbox.newest(STATE)
    assert newest is not None
    assert newest.counter == (tick - 1) % 128
    assert inbox.counts == ReceptionCounts()


def test_send_command(benchmark: BenchmarkFixture) -> None:
    """Encoded and sent to a virtual bus without another member."""
    with open_bus("virtual", "benchmark") as bus:
        outbox = Outbox(bus, Node.CONTROLLER)
        benchmark(lambda: outbox.send(COMMAND, Command(CONTROL, Mode.NOMINAL), 0, counter=0))
        assert outbox.sent > 0
        assert outbox.send_failures == 0


@pytest.fixture(params=MODELS)
def bundle(request: pytest.FixtureRequest) -> Bundle:
    return load_bundle(shipped_model(request.param))


def test_lift(benchmark, bundle: Bundle) -> None:
    encoder = Encoder(bundle)
    assert benchmark(encoder.lift, VEHICLE_STATE, 0.001).shape == (bundle.n_observables,)


def test_update_vectors(benchmark, bundle: Bundle) -> None:
    """From the parameters to the vectors of the QP."""
    settings = MpcSettings()
    qp = CondensedQp(bundle, settings.horizon, settings.cost())
    benchmark(qp.update_vectors)
    assert np.all(np.isfinite(qp.program.q))


def test_plan(benchmark, bundle: Bundle) -> None:
    """Lift, reference, matrices, vectors and solve; the time of the solve is in `extra_info`."""
    settings = MpcSettings()
    mpc = Mpc(bundle, settings.horizon, settings.cost())
    solve_us: list[float] = []

    def plan() -> SolveStatus:
        status = mpc.plan(VEHICLE_STATE, 0.001, WANTED, PREVIOUS)
        solve_us.append(mpc.solve_ns / 1e3)
        return status

    assert benchmark(plan) is SolveStatus.SOLVED
    benchmark.extra_info["qp_p50_us"] = float(np.median(solve_us))
    benchmark.extra_info["qp_iterations"] = mpc.iterations


@pytest.mark.parametrize("name", BASELINES)
def test_plan_of_a_baseline(benchmark, name: str) -> None:
    """The same with control laws that need no learned model, their preparation included."""
    planner = LawPlanner(load_bundle(shipped_model()), open_law(name), name)
    assert benchmark(planner.plan, VEHICLE_STATE, 0.001, WANTED, PREVIOUS) is SolveStatus.SOLVED


def test_assembly(benchmark, bundle: Bundle) -> None:
    """Assembly of the controller at start."""
    settings = MpcSettings()
    benchmark(Mpc, bundle, settings.horizon, settings.cost())


@cache
def recorded(tier: str) -> Recording:
    return record("mdk-net-paper", SHORT_LANE_CHANGE, TIERS[tier])


@pytest.mark.parametrize("warm_start", [True, False])
@pytest.mark.parametrize("tier", TIERS)
def test_solve(benchmark, tier: str, warm_start: bool) -> None:
    recording = recorded(tier)
    program = recording.program.copy()
    workspace = open_solver(program, warm_start=warm_start)
    events = recording.replay(program)

    def go_to_next_tick() -> None:
        nonlocal events
        while True:
            event = next(events, None)
            if event is None:
                events = recording.replay(program)
            elif isinstance(event, Matrices):
                workspace.update_matrices()
            elif event.is_warm_up:
                workspace.solve()
            else:
                return

    status = benchmark.pedantic(workspace.solve, setup=go_to_next_tick, rounds=400)
    assert status is SolveStatus.SOLVED


@pytest.fixture(params=MODELS)
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
