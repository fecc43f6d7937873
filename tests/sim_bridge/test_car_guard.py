"""The vehicle guards itself: commands that it follows, when it brakes, failed actuators."""

from dataclasses import dataclass, field

import pytest
from made_frames import can_frame, can_frames

from rt_controller.bus.identity import own_identity
from rt_controller.bus.messages import (
    COMMAND,
    CONTROLLER_IDENTITY,
    HEARTBEAT,
    STATE,
    Command,
    Heartbeat,
    Identity,
    Node,
    StateSample,
)
from rt_controller.bus.receive import Inbox, Received
from rt_controller.contract.faults import NO_REFUSAL, Fault, Refusal
from rt_controller.contract.signals import AT_REST, NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import COMMAND_TIMEOUT_TICKS, PERIOD_NS
from rt_controller.vehicle.braking_cause import BrakingCause
from rt_controller.vehicle.vehicle_envelope import FARTHEST_OFF_PATH_M, STANDING, OwnMotion
from sim_bridge.car_guard import (
    FAILED_TICKS,
    FOREIGN_TICKS,
    Actuator,
    ActuatorWatchdog,
    CommandCheck,
    FailedActuators,
)

CRUISE = Command(ControlInput(0.2, 0.0, 0.0), Mode.NOMINAL)
TURNED = Command(CRUISE.control._replace(steer_rad=0.16), Mode.NOMINAL)
"""as far as the wheel turns in two periods"""
OTHER_STATE = StateSample(AT_REST, 0.0, 0, None, False)
MOVING = OwnMotion(20.0, 0.0, is_mission_on=True)
FAR = OwnMotion(20.0, 1.5, is_mission_on=True)


@dataclass(slots=True)
class Rig:
    """A check that has followed a few commands; `tick` sends one and judges it."""

    check: CommandCheck = field(default_factory=CommandCheck)
    inbox: Inbox = field(default_factory=lambda: Inbox(Node.VEHICLE))
    counter: int = 120
    """of the newest state"""

    @property
    def now_ns(self) -> int:
        return self.counter * PERIOD_NS

    @property
    def followed(self) -> int | None:
        """Ticks since the state that the newest followed command answers."""
        accepted = self.check.accepted
        return None if accepted is None else (self.counter - 1 - accepted.counter) % 128

    def accept(self, message, content, counter: int) -> None:
        for frame in can_frames(message, content, counter):
            self.inbox.accept(frame, self.now_ns)

    def send(self, command: Command, counter: int, mode: Mode | None = None) -> None:
        self.accept(COMMAND, command, counter)
        heartbeat = Heartbeat(mode or command.mode, Fault(0), counter % 128, 0, 0, 1)
        self.accept(HEARTBEAT, heartbeat, counter)

    def judge(self) -> Refusal:
        self.check.take(self.inbox, self.now_ns, self.counter % 128, MOVING)
        self.inbox.end_period(self.now_ns)
        self.counter += 1
        return self.check.refusals

    def tick(self, command: Command = CRUISE) -> Refusal:
        self.send(command, self.counter)
        return self.judge()


@pytest.fixture
def rig() -> Rig:
    rig = Rig()
    assert [rig.tick() for _ in range(5)] == [NO_REFUSAL] * 5
    return rig


def test_commands_are_followed_from_the_second_one_on_while_the_long_counter_wraps() -> None:
    rig = Rig()
    assert rig.judge() == NO_REFUSAL
    rig.tick()
    assert rig.followed is None
    assert [(rig.tick(), rig.followed) for _ in range(20)] == [(NO_REFUSAL, 0)] * 20
    assert not rig.check.refused_ticks


def test_the_wheel_may_move_on_since_the_last_command_that_was_followed(rig: Rig) -> None:
    """Commands were missing; the vehicle was held up; the command answers an older state."""
    assert [rig.tick(TURNED) for _ in range(2)] == [Refusal.STEERING, NO_REFUSAL]
    rig.tick(), rig.tick(), rig.tick()
    rig.counter += 1
    assert rig.tick(TURNED) == NO_REFUSAL
    rig.tick(), rig.tick(), rig.tick()
    rig.judge()  # without a command; the next one answers the state of this tick
    rig.send(TURNED, rig.counter - 1)
    assert rig.judge() == NO_REFUSAL


@pytest.mark.parametrize("lag", range(8))
def test_a_command_that_answers_an_old_state_is_refused(rig: Rig, lag: int) -> None:
    rig.counter += lag  # the counters of the commands stand still for so long
    rig.send(CRUISE, rig.counter - lag)
    assert rig.judge() == (Refusal.LATE if lag >= COMMAND_TIMEOUT_TICKS else NO_REFUSAL)


@pytest.mark.parametrize("silent", [1, 5, 6, 11])
def test_a_heartbeat_that_is_silent_or_says_otherwise_is_refused(rig: Rig, silent: int) -> None:
    rig.send(CRUISE, rig.counter, mode=Mode.SAFE_STOP)
    assert rig.judge() == Refusal.HEARTBEAT
    rig.accept(COMMAND, CRUISE, rig.counter)
    contradicting = Heartbeat(CRUISE.mode, Fault(0), (rig.counter + 1) % 128, 0, 0, 1)
    rig.accept(HEARTBEAT, contradicting, rig.counter)
    assert rig.judge() == Refusal.HEARTBEAT
    assert rig.tick() == NO_REFUSAL
    for _ in range(silent):
        rig.accept(COMMAND, CRUISE, rig.counter)
        assert rig.judge() == Refusal.HEARTBEAT
    assert rig.tick() == (Refusal.HEARTBEAT if silent >= 6 else NO_REFUSAL)


def test_a_refused_command_leaves_the_one_before(rig: Rig) -> None:
    both = Command(ControlInput(0.2, 50.0, 0.0), Mode.NOMINAL)
    assert (rig.tick(both), rig.followed) == (Refusal.PEDALS, 1)
    assert (rig.tick(), rig.followed) == (NO_REFUSAL, 0)
    assert rig.check.refused_ticks == {"PEDALS": 1}
    for _ in range(6):  # damaged frames
        rig.inbox.accept(can_frame(COMMAND.codecs[0], bytes(8)), rig.now_ns)
        rig.judge()
    assert rig.followed == 6


@pytest.mark.parametrize(("steer_rad", "lost"), [(0.25, 0), (0.3, 2)])
def test_the_first_command_may_turn_the_wheel_by_the_periods_before_it_up_to_a_time_out(
    steer_rad: float, lost: int
) -> None:
    rig = Rig()
    standing = Command(NEUTRAL_INPUT._replace(steer_rad=steer_rad), Mode.STANDSTILL)
    rig.tick(standing)
    rig.counter += lost
    assert rig.tick(standing) == Refusal.STEERING
    third = Refusal.STEERING if steer_rad > 0.264 else NO_REFUSAL  # three periods
    assert [rig.tick(standing) for _ in range(3)] == [third, NO_REFUSAL, NO_REFUSAL]


@pytest.mark.parametrize("offset", [0, 1, 3, 8, 15])
def test_a_second_controller_is_followed_by_none(rig: Rig, offset: int) -> None:
    refused = 0
    for _ in range(8):
        rig.send(CRUISE, rig.counter)
        rig.send(Command(ControlInput(0.0, 10.0, 0.05), Mode.NOMINAL), rig.counter + offset)
        refused += rig.judge() == Refusal.SOURCE
    assert refused >= 7


def test_a_controller_of_another_catalogue_is_followed_no_more(rig: Rig) -> None:
    found = []
    for k, identity in enumerate([own_identity(1), Identity(1, 1), Identity(1, 1)]):
        rig.accept(CONTROLLER_IDENTITY, identity, k)
        found.append(rig.tick())
    assert found == [NO_REFUSAL, NO_REFUSAL, Refusal.SOURCE]


@pytest.mark.parametrize(("ticks_before", "frames"), [(0, 1), (1, None), (5, 1)])
def test_frames_of_another_vehicle_count_after_some_ticks_in_a_row(
    ticks_before: int, frames: int | None
) -> None:
    rig = Rig()
    found = [rig.tick() for _ in range(ticks_before)]
    for k in range(FOREIGN_TICKS + 1):
        for frame in can_frames(STATE, OTHER_STATE, k)[:frames]:
            rig.inbox.accept(frame, rig.now_ns)
        found.append(rig.tick())
    assert found == [NO_REFUSAL] * (FOREIGN_TICKS - 1 + ticks_before) + [Refusal.SOURCE] * 2
    assert rig.tick() == NO_REFUSAL


# The watchdog

STEER_RAD = 0.1


class Watchdog(ActuatorWatchdog):
    """Judges and brakes as the bridge does."""

    def apply(
        self,
        command: Received[Command] | None,
        now_ns: int = 0,
        state_counter: int = 0,
        motion: OwnMotion = MOVING,
        has_failed: bool = False,
        steer_rad: float = STEER_RAD,
        **braking,
    ) -> ControlInput:
        if self.judge(command, now_ns, state_counter, motion, has_failed):
            self.brake(steer_rad, **braking)
        return self.applied

    @property
    def is_braking(self) -> bool:
        return self.braking_cause is not None


def command(arrival_ns: int = 0, counter: int = 0, mode: Mode = Mode.NOMINAL) -> Received[Command]:
    return Received(Command(ControlInput(0.4, 0.0, 0.3), mode), counter, arrival_ns)


@pytest.fixture
def watchdog() -> Watchdog:
    return Watchdog()


@pytest.mark.parametrize(
    ("age_ns", "lag", "is_braking"),
    [
        *((age_ns, 0, False) for age_ns in (0, 75_000_000, 87_500_000)),
        (87_500_001, 0, True),
        # A command that dawdled on the bus is as old as the state that it answers.
        *((0, lag, 4 <= lag < 124) for lag in (1, 3, 4, 5, 64, 123, 124, 127)),
    ],
)
def test_a_fresh_command_is_applied_unchanged_and_one_of_100_ms_is_braked_for(
    watchdog: Watchdog, age_ns: int, lag: int, is_braking: bool
) -> None:
    applied = watchdog.apply(command(), age_ns, lag)
    assert applied == (ControlInput(0.0, 3.75, STEER_RAD) if is_braking else command().content[0])
    assert watchdog.is_braking is is_braking
    # A controller that comes back does not get the braking car back.
    assert watchdog.apply(command(225_000_000), 225_000_000).throttle == 0.4 * (not is_braking)


@pytest.mark.parametrize(
    ("sent", "speed_mps", "has_ended"),
    [
        ("N", 0.0, False),
        ("NS", 80.0 / 3.6, False),  # a crash, or a third Ctrl-C, at speed
        ("NS", 0.9, False),  # a crash at low speed
        ("NSSSS", 0.5, False),
        ("NSSSSS", 0.5, True),
        ("SSSS", 0.5, False),
        ("SSSSS", 0.5, True),
        ("NSSSSS", 0.99, True),
        ("NSSSSS", 1.0, False),
        ("NSSSSS", 20.0, False),
        ("NSSSSSSSS", 0.9, True),
        ("NSSSNSSSS", 0.5, False),
        ("NSSSNSSSSS", 0.5, True),
    ],
)
def test_silence_is_the_end_of_a_drive_after_a_long_safe_stop_and_at_low_speed(
    watchdog: Watchdog, sent: str, speed_mps: float, has_ended: bool
) -> None:
    """`sent`: commands in NOMINAL and in SAFE_STOP."""
    motion = MOVING._replace(speed_mps=speed_mps)
    for k, letter in enumerate(sent):
        last = command(k * PERIOD_NS, k, Mode.SAFE_STOP if letter == "S" else Mode.NOMINAL)
        watchdog.apply(last, k * PERIOD_NS, k, motion)
    for k in range(len(sent), len(sent) + 4):
        assert not watchdog.has_controller_ended
        watchdog.apply(last, k * PERIOD_NS, k, motion)
    assert watchdog.is_braking
    assert watchdog.has_controller_ended is has_ended
    watchdog.apply(command(10**10, 0, Mode.SAFE_STOP), 10**10, 0, STANDING)
    assert watchdog.has_controller_ended is has_ended


def test_a_car_on_the_way_to_its_path_has_not_left_it() -> None:
    for nearest_m, is_braked in ((0.49, True), (0.5, False), (0.51, False)):
        watchdog = Watchdog()
        for off_m in (0.95, nearest_m, 0.95):
            watchdog.apply(command(), motion=MOVING._replace(off_path_m=off_m))
        assert watchdog.is_braking is is_braked


@pytest.mark.parametrize(
    ("braking", "step_n", "most_n"),
    [({}, 3.75, 75.0), ({"is_wheel_stuck": True}, 12.5, 150.0), ({"brake_n": 60.0}, 3.75, 60.0)],
)
@pytest.mark.parametrize("first_n", [0.0, 40.0])
def test_the_brake_ramps_from_the_last_command_while_the_wheel_follows_the_path(
    watchdog: Watchdog, braking: dict[str, float], step_n: float, most_n: float, first_n: float
) -> None:
    watchdog.apply(Received(Command(ControlInput(0.0, first_n, 0.0), Mode.NOMINAL), 0, 0))
    for k in range(25):
        applied = watchdog.apply(None, has_failed=True, steer_rad=0.01 * k, **braking)
        assert applied == ControlInput(
            0.0, pytest.approx(min(first_n + step_n * (k + 1), most_n)), 0.01 * k
        )


@pytest.mark.parametrize(
    ("motion", "age_ns", "has_failed", "cause"),
    [
        (MOVING, 0, False, None),
        (MOVING, 4 * PERIOD_NS, False, BrakingCause.NO_COMMAND),
        (FAR, 0, False, BrakingCause.LEAVING_PATH),
        (FAR, 4 * PERIOD_NS, False, BrakingCause.NO_COMMAND),
        (MOVING, 0, True, BrakingCause.ACTUATOR_FAILED),
        (FAR, 4 * PERIOD_NS, True, BrakingCause.ACTUATOR_FAILED),
    ],
)
def test_the_first_cause_to_brake_is_kept(
    watchdog: Watchdog, motion: OwnMotion, age_ns: int, has_failed: bool, cause: BrakingCause | None
) -> None:
    watchdog.apply(command())
    watchdog.apply(command(), age_ns, 0, motion, has_failed)
    assert watchdog.braking_cause is cause
    for failed in (False, True, False):
        watchdog.apply(None, motion=FAR, has_failed=failed)
        assert watchdog.braking_cause is (cause or BrakingCause.NO_COMMAND)


def test_a_safe_stop_that_leaves_the_path_is_driven_by_the_vehicle_at_once(
    watchdog: Watchdog,
) -> None:
    off = MOVING._replace(off_path_m=0.9 * FARTHEST_OFF_PATH_M)
    stop = command(mode=Mode.SAFE_STOP)
    assert watchdog.apply(stop, motion=off).steer_rad == 0.3
    off = off._replace(off_path_m=-1.1 * FARTHEST_OFF_PATH_M)
    assert watchdog.apply(stop, motion=off).steer_rad == STEER_RAD
    assert watchdog.is_braking


# Failed actuators

COASTING = ControlInput(0.0, 0.0, 0.0)
FOLLOWS = (COASTING, COASTING)
STUCK = (COASTING._replace(steer_rad=0.1), COASTING)
OPEN = (COASTING, COASTING._replace(throttle=0.2))
Pairs = list[tuple[ControlInput, ControlInput]]


def wheel(commanded_rad: float, applied_rad: float) -> tuple[ControlInput, ControlInput]:
    return COASTING._replace(steer_rad=commanded_rad), COASTING._replace(steer_rad=applied_rad)


def throttle(commanded: float, applied: float) -> tuple[ControlInput, ControlInput]:
    return COASTING._replace(throttle=commanded), COASTING._replace(throttle=applied)


def after(pairs: Pairs) -> list[Actuator]:
    """What has failed after these periods of (commanded, applied)."""
    actuators = FailedActuators()
    assert actuators.open_throttle == 0.0
    for commanded, applied in pairs:
        actuators.note(commanded, applied)
        assert actuators.open_throttle >= 0.0
    return actuators.failed


@pytest.mark.parametrize(
    ("pairs", "failed"),
    [
        ([wheel(0.1 + 0.03 * k, 0.0) for k in range(FAILED_TICKS)], [Actuator.STEERING_WHEEL]),
        ([wheel(0.1 + 0.03 * k, 0.0) for k in range(FAILED_TICKS - 1)], []),
        ([wheel(0.05 * k, 0.05 * (k - 2)) for k in range(20)], []),  # late, but it moves
        ([STUCK] * 3 + [FOLLOWS] + [STUCK] * 3, []),
        ([STUCK] * 3 + [FOLLOWS] + [STUCK] * 4, [Actuator.STEERING_WHEEL]),
        ([STUCK] * FAILED_TICKS + [FOLLOWS] * 10, [Actuator.STEERING_WHEEL]),  # it stays failed
        ([OPEN] * 3 + [FOLLOWS] + [OPEN] * 3, []),
        ([OPEN] * 3 + [FOLLOWS] + [OPEN] * 4, [Actuator.THROTTLE]),
        ([OPEN] * 3 + [STUCK] * 3, []),  # each is counted apart
        ([OPEN] * 4 + [(STUCK[0], OPEN[1])] * 8, [Actuator.THROTTLE, Actuator.STEERING_WHEEL]),
        ([throttle(0.5, 1.5)] * FAILED_TICKS, [Actuator.THROTTLE]),
        ([throttle(0.5, 0.551)] * FAILED_TICKS, [Actuator.THROTTLE]),
        ([throttle(0.5, 0.549)] * FAILED_TICKS, []),
        ([throttle(0.0, 0.05)] * FAILED_TICKS, []),
        ([throttle(0.5, 0.0)] * FAILED_TICKS, []),
        ([wheel(0.03, 0.0)] * 6, []),
        ([wheel(0.0, -0.05)] + [wheel(0.02, -0.05)] * 6, []),
        ([wheel(0.5, 1e-3 * (k % 2)) for k in range(1, 8)], []),
        ([wheel(0.3, 0.2)] * 14, []),
        ([wheel(0.3, 0.2)] * 10 + [wheel(0.319, 0.2)] * 4, []),
        ([wheel(0.3, 0.2)] * 10 + [wheel(0.321, 0.2)] * 4, [Actuator.STEERING_WHEEL]),
    ],
)
def test_an_actuator_that_does_not_follow_for_100_ms_has_failed(
    pairs: Pairs, failed: list[Actuator]
) -> None:
    assert after(pairs) == failed


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("angle_rad", "error_rad", "moved_rad", "has_failed"),
    [
        (0.0, 0.031, 0.0, True),
        (0.0, 0.029, 0.0, False),
        (0.2, -0.031, 0.0, True),
        (0.2, -0.029, 0.0, False),
        (0.2, 0.04, 0.0009, True),
        (0.2, 0.04, -0.0009, True),
        (0.2, 0.04, 0.0011, False),
        (0.2, 0.04, -0.0011, False),
    ],
)
def test_a_wheel_is_stuck_where_it_is_if_it_does_not_move_and_is_off(
    side: float, angle_rad: float, error_rad: float, moved_rad: float, has_failed: bool
) -> None:
    angles = [side * (angle_rad + k * moved_rad) for k in range(6)]
    pairs = [wheel(each + side * error_rad, each) for each in angles]
    assert bool(after([wheel(angles[0], angles[0]), *pairs[1:]])) is has_failed
