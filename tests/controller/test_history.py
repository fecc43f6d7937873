"""The history that the encoder gets: states with the inputs applied from them, or restarted."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_models import WITH_PAST, make_bundle
from scripted_vehicle import CRUISING, ENGAGED, Rig, build_rig

from rt_controller.bus.messages import STATE, Command, StateSample
from rt_controller.config import MpcSettings
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode, VehicleState
from rt_controller.control.lift import Encoder
from rt_controller.control.mpc import Mpc
from rt_controller.model.validation import DRIVABLE_HISTORY
from rt_controller.safety.tick import Tick

STEPS = WITH_PAST.history_steps
RESOLUTION = np.array([0.0, 0.0, 0.0, 1.1e-5, 1.3e-3, 1.8e-4])
"""resolution of a row: exact states, and commands as the frames quantise them"""
Row = tuple[float, ...]


class Watched:
    """A rig that copies the history of each lift: `shown` is that of the last tick, or None.

    The vehicle echoes each command `echo_lag` ticks after it was sent.
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.shown: np.ndarray | None = None
        self.echo_lag = 1
        self._accepted = [(rig.heartbeat.state_counter, rig.command.content)]
        """state counters and contents of the commands"""

    @property
    def applied(self) -> tuple[int, Command] | None:
        """The command applied before the next state; None: none was."""
        known = len(self._accepted) >= self.echo_lag
        return self._accepted[-self.echo_lag] if known else None

    def tick(self, skipped: int = 0, **vehicle: object) -> Tick:
        """One tick; the keywords change what the vehicle sends from now on."""
        command = self.applied
        self.rig.vehicle.command_echo = None if command is None else command[0]
        for name, value in vehicle.items():
            setattr(self.rig.vehicle, name, value)
        self.shown = None
        result = self.rig.tick(skipped=skipped)
        self._accepted.append((self.rig.heartbeat.state_counter, self.rig.command.content))
        return result

    def received(self) -> VehicleState:
        """The newest state, as received over the bus."""
        newest = self.rig.inbox.newest(STATE)
        return newest.content.state


@contextmanager
def watch(mpc: Mpc) -> Iterator[Watched]:
    """A watched rig; the encoder is restored at the end of the context."""
    lift: Callable[[Encoder, VehicleState, float], np.ndarray] = Encoder.lift
    with build_rig(mpc) as rig, pytest.MonkeyPatch.context() as patch:
        watched = Watched(rig)

        def watched_lift(encoder: Encoder, state: VehicleState, curvature: float) -> np.ndarray:
            watched.shown = encoder.history.copy()
            return lift(encoder, state, curvature)

        patch.setattr(Encoder, "lift", watched_lift)
        yield watched


@pytest.fixture(scope="module")
def mpc() -> Mpc:
    settings = MpcSettings()
    bundle = make_bundle(WITH_PAST, rank=1)
    return Mpc(bundle, settings.horizon, settings.cost())


@pytest.fixture
def watched(mpc: Mpc) -> Iterator[Watched]:
    with watch(mpc) as watched:
        yield watched


def moving(k: int) -> VehicleState:
    """A different state for every k."""
    return CRUISING._replace(vx_mps=20.0 + 0.1 * k, vy_mps=0.01 * k, yaw_rate_radps=-0.002 * k)


def row(state: VehicleState, held: ControlInput) -> Row:
    named = {**state._asdict(), **held._asdict()}
    return tuple(named[name] for name in DRIVABLE_HISTORY)


def assert_shown(watched: Watched, rows: list[Row]) -> None:
    assert watched.shown is not None
    np.testing.assert_array_equal(watched.shown, np.array(rows, dtype=np.float32))


def assert_restarted(watched: Watched, held: ControlInput) -> None:
    assert_shown(watched, [row(watched.received(), held)] * STEPS)


def drive_ticks(watched: Watched, ticks: int, first: int = 0) -> list[Row]:
    """The rows expected: each state with the command that was sent for it."""
    driven = []
    for k in range(first, first + ticks):
        result = watched.tick(state=moving(k))
        driven.append(row(watched.received(), result.control))
    return driven


def test_rows_are_states_with_the_commands_sent_for_them(watched):
    driven = drive_ticks(watched, 1)
    before = (*driven[0][:3], *NEUTRAL_INPUT)
    for k in range(1, 3 * STEPS):
        driven += drive_ticks(watched, 1, first=k)
        assert_shown(watched, ([before] * STEPS + driven[:k])[-STEPS:])
    assert len(set(driven)) == len(driven)


def send_one_more_state(watched: Watched, k: int) -> None:
    """The vehicle sends a second state before the controller reads the first."""
    rig = watched.rig
    echo = rig.heartbeat.state_counter
    sample = StateSample(moving(k), 0.0, rig.clock.now_ns(), echo, False)
    rig.vehicle.counter += 1
    rig.vehicle.outbox.send(STATE, sample, rig.clock.now_ns(), counter=rig.vehicle.counter)


def test_a_state_that_was_not_planned_from_restarts_the_history(watched):
    drive_ticks(watched, 6)
    sent = watched.rig.step.last.control
    send_one_more_state(watched, 6)
    watched.tick(state=moving(7))
    assert_restarted(watched, sent)


events = st.sampled_from(["state", "state", "state", "none", "skip", "standby", "brakes", "late"])


@settings(max_examples=30)
@given(st.lists(events, min_size=1, max_size=40))
def test_consecutive_rows_are_one_period_apart_for_any_sequence_of_events(mpc, script):
    """Each row is a state and the input applied from it, in the period before the next row."""
    with watch(mpc) as watched:
        past: list[Row] = []
        last: VehicleState | None = None
        for k, event in enumerate(script):
            is_standby = watched.rig.step.last.mode is Mode.STANDBY
            watched.echo_lag = 2 if event == "late" else 1
            command = watched.applied
            watched.tick(
                skipped=int(event == "skip"),
                state=None if event == "none" else moving(k),
                mission=ENGAGED._replace(is_engaged=event != "standby"),
                is_watchdog_braking=event == "brakes",
            )
            if event == "none":
                last = None
                continue
            held = NEUTRAL_INPUT if command is None else command[1].control
            is_driven = command is not None and not is_standby and event != "brakes"
            if last is None or event == "skip" or not is_driven:
                past = [row(watched.received(), held)] * STEPS
            else:
                past.append(row(last, held))
            last = watched.received()
            if watched.shown is not None:
                difference = np.abs(watched.shown - np.array(past[-STEPS:], dtype=np.float32))
                assert np.all(difference <= RESOLUTION)
