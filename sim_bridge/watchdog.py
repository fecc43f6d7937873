"""The watchdog of the actuators: a command that is missing or old ends in a braked car."""

from rt_controller.bus.catalogue import Command
from rt_controller.bus.inbox import Received
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput
from rt_controller.contract.timing import COMMAND_TIMEOUT_S, PERIOD_NS, PERIOD_S, counter_lag

COMMAND_TIMEOUT_NS = round(COMMAND_TIMEOUT_S * 1e9) - PERIOD_NS // 2
"""ages are about multiples of the period: the limit lies between two of them"""
BRAKE_N = 100.0
BRAKE_RATE_N_PER_S = 300.0
STEER_RETURN_RADPS = 0.7


class ActuatorWatchdog:
    """Chooses the input of the actuators, tick by tick.

    It brakes whatever the reason why the commands stopped. Once it has braked it keeps braking: a
    controller that returns during the stop does not take over again; only a restart allows that.
    """

    def __init__(self) -> None:
        self.applied = NEUTRAL_INPUT
        self.is_braking = False

    def apply(
        self, command: Received[Command] | None, now_ns: int, state_counter: int
    ) -> ControlInput:
        """The input for the coming period; `state_counter` is that of the newest state sent.

        The age of a command is the larger one of the time since its arrival and the age of the
        state that it answers, so a command that was delayed on the bus counts as old.
        """
        if command is None:
            self.is_braking = True
        else:
            lag = counter_lag(newer=state_counter, older=command.counter)
            age_ns = max(now_ns - command.arrival_ns, lag * PERIOD_NS)
            self.is_braking = self.is_braking or age_ns > COMMAND_TIMEOUT_NS
        if self.is_braking or command is None:
            self.applied = self._brake()
        else:
            self.applied = command.content.control
        return self.applied

    def _brake(self) -> ControlInput:
        change_rad = STEER_RETURN_RADPS * PERIOD_S
        steer_rad = self.applied.steer_rad
        return ControlInput(
            throttle=0.0,
            brake_n=min(self.applied.brake_n + BRAKE_RATE_N_PER_S * PERIOD_S, BRAKE_N),
            steer_rad=steer_rad - min(max(steer_rad, -change_rad), change_rad),
        )
