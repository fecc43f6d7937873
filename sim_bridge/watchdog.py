"""The watchdog of the actuators: a command that is missing or old ends in a braked car."""

from rt_controller.bus.catalogue import Command
from rt_controller.bus.inbox import Received
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import (
    COMMAND_TIMEOUT_S,
    COMMAND_TIMEOUT_TICKS,
    PERIOD_NS,
    PERIOD_S,
    counter_lag,
)

COMMAND_TIMEOUT_NS = round(COMMAND_TIMEOUT_S * 1e9) - PERIOD_NS // 2
"""ages are about multiples of the period: the limit lies between two of them"""
BRAKE_N = 100.0
BRAKE_RATE_N_PER_S = 300.0
STEER_RETURN_RADPS = 0.7
ORDERLY_MPS = 1.0
"""a drive that ends on purpose ends below this speed: the controller stops sending when it has
received a speed below 0.3 m/s"""
ORDERLY_TICKS = 2 * COMMAND_TIMEOUT_TICKS
"""a drive that ends on purpose ends after a safe stop of at least this length. A controller that
crashes sends one such command, which is in use for half as long"""


class ActuatorWatchdog:
    """Chooses the input of the actuators, tick by tick.

    It brakes whatever the reason why the commands stopped. Once it has braked it keeps braking: a
    controller that returns during the stop does not take over again; only a restart allows that.
    """

    def __init__(self) -> None:
        self.applied = NEUTRAL_INPUT
        self.is_braking = False
        self.has_controller_ended = False
        """True if the commands stopped after a safe stop, at `ORDERLY_MPS` at most: the controller
        ended its drive, and did not fail while it drove"""
        self._safe_stop_ticks = 0

    def apply(
        self,
        command: Received[Command] | None,
        now_ns: int,
        state_counter: int,
        speed_mps: float,
    ) -> ControlInput:
        """The input for the coming period.

        Args:
            command: the newest one; None: none has arrived.
            now_ns: time of this tick.
            state_counter: of the newest state that was sent.
            speed_mps: of the car.

        The age of a command is the larger one of the time since its arrival and the age of the
        state that it answers, so a command that was delayed on the bus counts as old.
        """
        if command is None:
            self.is_braking = True
        elif not self.is_braking:
            lag = counter_lag(newer=state_counter, older=command.counter)
            age_ns = max(now_ns - command.arrival_ns, lag * PERIOD_NS)
            self.is_braking = age_ns > COMMAND_TIMEOUT_NS
            is_safe_stop = command.content.mode is Mode.SAFE_STOP
            self._safe_stop_ticks = self._safe_stop_ticks + 1 if is_safe_stop else 0
            self.has_controller_ended = (
                self.is_braking
                and self._safe_stop_ticks > ORDERLY_TICKS
                and speed_mps < ORDERLY_MPS
            )
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
