"""The watchdog of the actuators: without a command that may be followed the car is braked."""

from rt_controller.bus.contents import Command
from rt_controller.bus.end_to_end.assembly import Received
from rt_controller.contract.grip import (
    BRAKE_RATE_N_PER_S,
    FULL_BRAKE_N,
    FULL_BRAKE_RATE_N_PER_S,
    MOST_BRAKE_N,
)
from rt_controller.contract.signals import NEUTRAL_INPUT, ControlInput, Mode
from rt_controller.contract.timing import (
    COMMAND_TIMEOUT_NS,
    COMMAND_TIMEOUT_TICKS,
    PERIOD_NS,
    PERIOD_S,
    counter_lag,
)
from rt_controller.gateway.braking_cause import BrakingCause
from rt_controller.gateway.vehicle_envelope import FARTHEST_OFF_PATH_M, OwnMotion, leaves_path

ORDERLY_MPS = 1.0
"""a drive that ends on purpose ends below this speed: the controller stops sending when it has
received a speed below 0.3 m/s"""
ORDERLY_TICKS = 2 * COMMAND_TIMEOUT_TICKS
"""a drive that ends on purpose ends after a safe stop of at least this length. A controller that
crashes sends one such command, which is in use for half as long"""


class ActuatorWatchdog:
    """Chooses the input of the actuators, tick by tick.

    It brakes whatever the reason why the commands stopped. Once it brakes, it brakes until the
    program is restarted, also if commands arrive again.
    """

    def __init__(self) -> None:
        self.applied = NEUTRAL_INPUT
        self.braking_cause: BrakingCause | None = None
        """why it began to brake; None: it does not brake"""
        self.has_controller_ended = False
        """True if the commands stopped after a safe stop, at `ORDERLY_MPS` at most: the controller
        ended its drive, and did not fail while it drove"""
        self._safe_stop_ticks = 0
        self._has_reached_path = False

    @property
    def is_braking(self) -> bool:
        """True from the first cause to brake on."""
        return self.braking_cause is not None

    def apply(
        self,
        command: Received[Command] | None,
        now_ns: int,
        state_counter: int,
        motion: OwnMotion,
        steer_rad: float,
        brake_n: float = MOST_BRAKE_N,
        have_actuators_failed: bool = False,
        is_wheel_stuck: bool = False,
    ) -> ControlInput:
        """The input for the coming period.

        Args:
            command: the newest one that may be followed; None: none has arrived.
            now_ns: time of this tick.
            state_counter: of the newest state that was sent.
            motion: of the car, by its own measurement.
            steer_rad: wheel angle that leads along the path, for a car that brakes.
            brake_n: force that it brakes with.
            have_actuators_failed: the vehicle brakes by itself.
            is_wheel_stuck: it brakes with the full force.

        The age of a command is the larger one of the time since its arrival and the age of the
        state that it answers, so a command that was delayed on the bus counts as old.
        """
        if self.braking_cause is not None:
            pass
        elif have_actuators_failed:
            self.braking_cause = BrakingCause.ACTUATOR_FAILED
        elif command is None:
            self.braking_cause = BrakingCause.NO_COMMAND
        else:
            lag = counter_lag(newer=state_counter, older=command.counter)
            age_ns = max(now_ns - command.arrival_ns, lag * PERIOD_NS)
            is_old = age_ns > COMMAND_TIMEOUT_NS
            self._has_reached_path |= abs(motion.off_path_m) < FARTHEST_OFF_PATH_M
            is_leaving = leaves_path(command.content, motion, self._has_reached_path)
            if is_old:
                self.braking_cause = BrakingCause.NO_COMMAND
            elif is_leaving:
                self.braking_cause = BrakingCause.LEAVING_PATH
            is_safe_stop = command.content.mode is Mode.SAFE_STOP
            self._safe_stop_ticks = self._safe_stop_ticks + 1 if is_safe_stop else 0
            self.has_controller_ended = (
                self.is_braking
                and self._safe_stop_ticks > ORDERLY_TICKS
                and motion.speed_mps < ORDERLY_MPS
            )
        if self.is_braking or command is None:
            rate_n_per_s = BRAKE_RATE_N_PER_S
            if is_wheel_stuck:
                brake_n, rate_n_per_s = FULL_BRAKE_N, FULL_BRAKE_RATE_N_PER_S
            self.applied = self._brake(steer_rad, brake_n, rate_n_per_s)
        else:
            self.applied = command.content.control
        return self.applied

    def _brake(self, steer_rad: float, brake_n: float, rate_n_per_s: float) -> ControlInput:
        return ControlInput(
            throttle=0.0,
            brake_n=min(self.applied.brake_n + rate_n_per_s * PERIOD_S, brake_n),
            steer_rad=steer_rad,
        )
