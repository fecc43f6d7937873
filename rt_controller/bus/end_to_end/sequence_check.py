"""The receiver's half of the end-to-end protection: sequence of counters and state machine.

AUTOSAR profiles 22 and 5 share both; they differ in the checksum and in the modulus of the counter.
Source: AUTOSAR FO PRS E2EProtocol, "E2E_P22Check", "E2E_P05Check" and "E2E state machine".
"""

from enum import Enum
from typing import NamedTuple

MAX_DELTA_COUNTER = 6
"""largest difference of two counters in a row that is accepted: the five periods for which a drive
goes on without a path, and one; below half of 16, so that of two senders one is always refused"""


class CheckStatus(Enum):
    """Result of the check of one frame, or of a period without one."""

    OK = "the next counter"
    OK_SOME_LOST = "a later counter, by at most MaxDeltaCounter"
    REPEATED = "the counter of the frame before"
    WRONG_SEQUENCE = "an earlier counter, or one beyond MaxDeltaCounter"
    ERROR = "a wrong checksum or length"
    NO_NEW_DATA = "no frame in this period"

    @property
    def is_ok(self) -> bool:
        """True if the counter allows the use of the values."""
        return self is CheckStatus.OK or self is CheckStatus.OK_SOME_LOST


class LinkState(Enum):
    """State of the E2E state machine; only in VALID data may be used."""

    NO_DATA = "nothing was received yet"
    INIT = "the first frames were received"
    VALID = "the communication works"
    INVALID = "too many errors, or too few good frames"


class LinkConfig(NamedTuple):
    """Configuration of the state machine, in the words of AUTOSAR.

    `window` is the number of statuses that are looked at in a state, `min_ok` and `max_error` the
    number of good and of damaged frames among them that VALID needs.
    """

    window_init: int = 4
    window_valid: int = 8
    window_invalid: int = 4
    min_ok_init: int = 1
    min_ok_valid: int = 1
    min_ok_invalid: int = 3
    max_error_init: int = 1
    max_error_valid: int = 3
    max_error_invalid: int = 0


LINK = LinkConfig()
"""of messages that are sent every period. VALID is left after 8 periods without a good frame, or 4
damaged frames in 8, and reached again after 3 good ones: longer than a plan is held, so that a
sender which comes back finds the car in a safe stop"""


def check_counter(counter: int, last: int, modulus: int) -> CheckStatus:
    """Status of an intact frame with `counter` after one with the counter `last`."""
    delta = (counter - last) % modulus
    if delta == 1:
        return CheckStatus.OK
    if delta == 0:
        return CheckStatus.REPEATED
    return CheckStatus.OK_SOME_LOST if delta <= MAX_DELTA_COUNTER else CheckStatus.WRONG_SEQUENCE


class Link:
    """The E2E state machine of one frame identifier."""

    __slots__ = ("_config", "_errors", "_next", "_statuses", "state")

    def __init__(self, config: LinkConfig = LINK) -> None:
        self.state = LinkState.NO_DATA
        self._config = config
        self._statuses = [CheckStatus.NO_NEW_DATA] * config.window_valid
        """the last statuses, a ring"""
        self._next = 0
        self._errors = 0
        """damaged ones among them"""

    def add(self, status: CheckStatus) -> None:
        """Take the status of one frame, or of one period without a frame."""
        if self.state is LinkState.VALID and status is CheckStatus.OK:
            self._push(status)
            if self._errors == 0:  # the usual case: nothing to count
                return
        elif self.state is LinkState.NO_DATA:
            if status not in (CheckStatus.ERROR, CheckStatus.NO_NEW_DATA):
                self.state = LinkState.INIT
            return
        else:
            self._push(status)
        config = self._config
        if self.state is LinkState.INIT:
            n_ok, n_errors = self._count(config.window_init)
            if n_errors > config.max_error_init:
                self.state = LinkState.INVALID
            elif n_ok >= config.min_ok_init:
                self.state = LinkState.VALID
        elif self.state is LinkState.VALID:
            n_ok, n_errors = self._count(config.window_valid)
            if n_errors > config.max_error_valid or n_ok < config.min_ok_valid:
                self.state = LinkState.INVALID
        else:
            n_ok, n_errors = self._count(config.window_invalid)
            if n_errors <= config.max_error_invalid and n_ok >= config.min_ok_invalid:
                self.state = LinkState.VALID

    def _push(self, status: CheckStatus) -> None:
        left = self._statuses[self._next]
        self._errors += (status is CheckStatus.ERROR) - (left is CheckStatus.ERROR)
        self._statuses[self._next] = status
        self._next = (self._next + 1) % len(self._statuses)

    def _count(self, window: int) -> tuple[int, int]:
        """Good and damaged ones among the last `window` statuses."""
        n_ok = n_errors = 0
        for age in range(1, window + 1):
            status = self._statuses[self._next - age]
            if status.is_ok:
                n_ok += 1
            elif status is CheckStatus.ERROR:
                n_errors += 1
        return n_ok, n_errors
