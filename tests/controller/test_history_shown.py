"""What the encoder is shown of the past is what the car did under our commands, or begun anew."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_models import WITH_PAST, make_bundle
from scripted_vehicle import CRUISING, ENGAGED, STRAIGHT, Rig, build_rig

from rt_controller.bus.frames import RoadSample
from rt_controller.bus.snapshot import CommandSnapshot
from rt_controller.config import MpcSettings
from rt_controller.contract.fitness import DRIVABLE_HISTORY
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode, VehicleState
from rt_controller.control.lift import Encoder
from rt_controller.control.mpc import Mpc
from rt_controller.outcome import StepOutcome

STEPS = WITH_PAST.history_steps
RESOLUTION = np.array([0.0, 0.0, 0.0, 1.1e-5, 1.3e-3, 3.6e-5])
"""of a row as the vehicle knows it: its own states, and commands as frames can say them"""

Row = tuple[float, ...]


class Watched:
    """A rig whose encoder is watched: `shown` is what the last tick lifted with, None if nothing.

    The vehicle echoes each command as soon as it has it, or `echo_lag` ticks later.
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.shown: np.ndarray | None = None
        self.echo_lag = 1
        self._accepted: list[CommandSnapshot] = []

    @property
    def in_force(self) -> CommandSnapshot | None:
        """The command in the period before the state that the vehicle tells next, if any was."""
        known = len(self._accepted) >= self.echo_lag
        return self._accepted[-self.echo_lag] if known else None

    def tick(self, skipped: int = 0, **vehicle: object) -> StepOutcome:
        """One tick; the keywords are what the vehicle says in it and from then on."""
        command = self.in_force
        self.rig.vehicle.command_echo = None if command is None else command.counter
        for name, value in vehicle.items():
            setattr(self.rig.vehicle, name, value)
        self.shown = None
        outcome = self.rig.tick(skipped=skipped)
        self._accepted.append(self.rig.command)
        return outcome

    def heard(self) -> VehicleState:
        """The newest state, as it came over the bus."""
        assert self.rig.inbox.state is not None
        return self.rig.inbox.state.state


@contextmanager
def watch(mpc: Mpc) -> Iterator[Watched]:
    """A watched rig, for as long as the context lasts."""
    lift: Callable[[Encoder, VehicleState, float], np.ndarray] = Encoder.lift
    with build_rig(mpc) as rig, pytest.MonkeyPatch.context() as patch:
        watched = Watched(rig)

        def watched_lift(encoder: Encoder, state: VehicleState, curvature: float) -> np.ndarray:
            assert encoder.history is not None
            watched.shown = encoder.history.copy()
            return lift(encoder, state, curvature)

        patch.setattr(Encoder, "lift", watched_lift)
        yield watched


@pytest.fixture(scope="module")
def mpc() -> Mpc:
    settings = MpcSettings()
    bundle = make_bundle(WITH_PAST, rank=1)
    return Mpc(bundle, settings.horizon, settings.cost(), INPUT_LIMITS)


@pytest.fixture
def watched(mpc: Mpc) -> Iterator[Watched]:
    with watch(mpc) as watched:
        yield watched


def moving(k: int) -> VehicleState:
    """Another state for every instant."""
    return CRUISING._replace(vx_mps=20.0 + 0.1 * k, vy_mps=0.01 * k, yaw_rate_radps=-0.002 * k)


def row(state: VehicleState, held: ControlInput) -> Row:
    named = {**state._asdict(), **held._asdict()}
    return tuple(named[name] for name in DRIVABLE_HISTORY)


def assert_shown(watched: Watched, rows: list[Row]) -> None:
    assert watched.shown is not None
    np.testing.assert_array_equal(watched.shown, np.array(rows, dtype=np.float32))


def assert_begun_anew(watched: Watched, held: ControlInput) -> None:
    assert_shown(watched, [row(watched.heard(), held)] * STEPS)


def drive(watched: Watched, ticks: int, first: int = 0) -> list[Row]:
    """Rows as driven: each state with the command that answered it."""
    driven = []
    for k in range(first, first + ticks):
        outcome = watched.tick(state=moving(k))
        driven.append(row(watched.heard(), outcome.control))
    return driven


def test_rows_are_states_with_the_commands_that_answered_them(watched: Watched) -> None:
    driven = drive(watched, 1)
    before = (*driven[0][:3], *NEUTRAL_INPUT)
    for k in range(1, 3 * STEPS):
        driven += drive(watched, 1, first=k)
        assert_shown(watched, ([before] * STEPS + driven[:k])[-STEPS:])
    assert len(set(driven)) == len(driven)


def test_at_the_first_tick_the_car_has_always_been_there_with_its_pedals_up(
    watched: Watched,
) -> None:
    watched.tick(state=moving(3))
    assert_begun_anew(watched, NEUTRAL_INPUT)


def test_a_command_that_comes_late_acts_a_period_later(watched: Watched) -> None:
    """The vehicle echoes the one before: that one was still in force."""
    driven = drive(watched, 6)
    watched.echo_lag = 2
    for k in range(6, 12):
        driven += drive(watched, 1, first=k)
    assert len(set(driven)) == len(driven)
    assert_shown(watched, [(*driven[j][:3], *driven[j - 1][3:]) for j in range(7, 11)])


def test_a_missed_state_begins_the_history_anew(watched: Watched) -> None:
    drive(watched, 6)
    outcome = watched.tick(state=None)
    assert outcome.mode is Mode.HOLD_PLAN
    held = outcome.control
    assert watched.tick(state=moving(8)).mode is Mode.NOMINAL
    assert_begun_anew(watched, held)
    first = row(watched.heard(), held)
    # Two commands answered under one counter, and a vehicle takes the first of them.
    watched.tick(state=moving(9))
    assert_shown(watched, [first] * STEPS)
    known = row(watched.heard(), watched.rig.step.outcome.control)
    watched.tick(state=moving(10))
    assert_shown(watched, [first] * (STEPS - 1) + [known])


def tell_another_state(watched: Watched, k: int) -> None:
    """The vehicle speaks once more before the controller looks."""
    rig = watched.rig
    road = RoadSample(0.0, rig.clock.now_ns(), rig.command.counter, False)
    rig.vehicle.outbox.send_state(moving(k), road, rig.clock.now_ns())


def test_a_state_that_was_overtaken_leaves_a_hole_and_begins_the_history_anew(
    watched: Watched,
) -> None:
    drive(watched, 6)
    sent = watched.rig.step.outcome.control
    tell_another_state(watched, 6)
    watched.tick(state=moving(7))
    assert_begun_anew(watched, sent)


@pytest.mark.parametrize("vehicle_stalls_too", [True, False])
def test_skipped_ticks_begin_the_history_anew(watched: Watched, vehicle_stalls_too: bool) -> None:
    drive(watched, 6)
    sent = watched.rig.step.outcome.control
    if not vehicle_stalls_too:
        tell_another_state(watched, 6)
    watched.tick(skipped=1, state=moving(7))
    assert_begun_anew(watched, sent)


def test_a_state_that_dawdled_is_a_hole(watched: Watched) -> None:
    drive(watched, 6)
    outcome = watched.tick(state=moving(6), stamped_late_ns=60_000_000)
    assert outcome.mode is Mode.HOLD_PLAN
    held = outcome.control
    watched.tick(state=moving(7), stamped_late_ns=0)
    assert_begun_anew(watched, held)


def test_standing_by_is_no_past(watched: Watched) -> None:
    drive(watched, 6)
    for k in range(6, 9):
        outcome = watched.tick(state=moving(k), mission=ENGAGED._replace(is_engaged=False))
    assert outcome.mode is Mode.STANDBY
    sent = outcome.control
    watched.tick(state=moving(9), mission=ENGAGED)
    assert_begun_anew(watched, sent)


def test_a_car_that_brakes_by_itself_does_not_follow_our_commands(watched: Watched) -> None:
    drive(watched, 6)
    for k in range(6, 9):
        sent = watched.rig.step.outcome.control
        outcome = watched.tick(state=moving(k), is_watchdog_braking=True)
        assert outcome.mode is Mode.SAFE_STOP
    assert_begun_anew(watched, sent)


@pytest.mark.parametrize("echo_ahead", [None, 2])
def test_as_long_as_no_command_of_ours_is_in_force_there_is_no_past(
    watched: Watched, echo_ahead: int | None
) -> None:
    """The vehicle has taken none yet, or still echoes the controller that drove before."""
    watched.echo_lag = 10**9
    for k in range(3):
        watched.tick(state=moving(k), command_echo=echo_ahead and k + echo_ahead)
        assert_begun_anew(watched, NEUTRAL_INPUT)


def test_a_plan_that_is_held_for_want_of_a_path_is_a_past_like_any_other(
    watched: Watched,
) -> None:
    driven = drive(watched, 6)
    watched.rig.vehicle.path = None
    modes = []
    for k in range(6, 11):
        outcome = watched.tick(state=moving(k))
        driven.append(row(watched.heard(), outcome.control))
        modes.append(outcome.mode)
    assert modes[-1] is Mode.HOLD_PLAN
    watched.tick(state=moving(11), path=STRAIGHT)
    assert_shown(watched, driven[-STEPS:])


events = st.sampled_from(["state", "state", "state", "none", "skip", "standby", "brakes", "late"])


@settings(max_examples=60, deadline=None)
@given(st.lists(events, min_size=1, max_size=40))
def test_no_history_has_a_hole_whatever_happens(mpc: Mpc, script: list[str]) -> None:
    """Each row is a state and what the vehicle did from there on, each the one before the next."""
    with watch(mpc) as watched:
        past: list[Row] = []
        last: VehicleState | None = None
        for k, event in enumerate(script):
            is_standing_by = watched.rig.step.outcome.mode is Mode.STANDBY
            watched.echo_lag = 2 if event == "late" else 1
            command = watched.in_force
            watched.tick(
                skipped=int(event == "skip"),
                state=None if event == "none" else moving(k),
                mission=ENGAGED._replace(is_engaged=event != "standby"),
                is_watchdog_braking=event == "brakes",
            )
            if event == "none":
                last = None
                continue
            held = NEUTRAL_INPUT if command is None else command.control
            obeys = command is not None and not is_standing_by and event != "brakes"
            if last is None or event == "skip" or not obeys:
                past = [row(watched.heard(), held)] * STEPS
            else:
                past.append(row(last, held))
            last = watched.heard()
            if watched.shown is not None:
                difference = np.abs(watched.shown - np.array(past[-STEPS:], dtype=np.float32))
                assert np.all(difference <= RESOLUTION)
