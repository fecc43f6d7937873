"""The actuators' own judgement: a command that is missing or old ends in a braked car."""

from rt_controller.bus.snapshot import CommandSnapshot
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import (
    COMMAND_TIMEOUT_S,
    PERIOD_NS,
    PERIOD_S,
    counter_lag,
)

COMMAND_TIMEOUT_NS = round(COMMAND_TIMEOUT_S * 1e9) - PERIOD_NS // 2
"""ages are multiples of the period, give or take: the limit lies between two of them"""
BRAKE_N = 100.0
BRAKE_RATE_N_PER_S = 300.0
STEER_EASE_RADPS = 0.7


class ActuatorWatchdog:
    """What reaches the actuators, tick by tick.

    It does not ask why the commands stopped. Once it has braked it keeps braking: a controller
    that comes back in mid-stop does not get the car back, only a new start gives it away.
    """

    def __init__(self) -> None:
        self.applied = NEUTRAL_INPUT
        self.is_braking = False

    def apply(
        self, command: CommandSnapshot | None, now_ns: int, state_counter: int
    ) -> ControlInput:
        """The input for the coming period; `state_counter` is that of the newest state sent.

        A command is as old as its arrival, or as the state that it answers: one that dawdled on
        the bus arrives young and is old all the same.
        """
        if command is None or _age_ns(command, now_ns, state_counter) > COMMAND_TIMEOUT_NS:
            self.is_braking = True
        if self.is_braking or command is None:
            self.applied = self._brake()
        else:
            self.applied = command.control
        return self.applied

    def _brake(self) -> ControlInput:
        change_rad = STEER_EASE_RADPS * PERIOD_S
        steer_rad = self.applied.steer_rad
        return ControlInput(
            throttle=0.0,
            brake_n=min(self.applied.brake_n + BRAKE_RATE_N_PER_S * PERIOD_S, BRAKE_N),
            steer_rad=steer_rad - min(max(steer_rad, -change_rad), change_rad),
        )


def is_driving(command: CommandSnapshot | None) -> bool:
    """Whether a controller has taken the car."""
    return command is not None and command.mode is Mode.NOMINAL


def _age_ns(command: CommandSnapshot, now_ns: int, state_counter: int) -> int:
    lag = counter_lag(newer=state_counter, older=command.counter)
    return max(now_ns - command.arrival_ns, lag * PERIOD_NS)
