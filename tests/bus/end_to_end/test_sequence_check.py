"""Sequence of counters and state machine, against AUTOSAR's rules written out independently."""

from collections import deque
from itertools import product
from random import Random

import pytest

from rt_controller.bus.end_to_end.sequence_check import (
    LINK,
    MAX_DELTA_COUNTER,
    CheckStatus,
    Link,
    LinkConfig,
    LinkState,
    check_counter,
)

OK, LOST = CheckStatus.OK, CheckStatus.OK_SOME_LOST
REPEATED, WRONG = CheckStatus.REPEATED, CheckStatus.WRONG_SEQUENCE
ERROR, NOTHING = CheckStatus.ERROR, CheckStatus.NO_NEW_DATA
MODULI = (16, 128, 256)
TIGHT = LinkConfig(3, 4, 3, 1, 1, 2, 0, 1, 0)


class Oracle:
    """The state machine as PRS E2EProtocol words it: counts over a window, then transitions."""

    def __init__(self, config: LinkConfig) -> None:
        self.config, self.state = config, "NODATA"
        self.window: deque[str] = deque(["NONEWDATA"] * config.window_valid, config.window_valid)

    def check(self, status: CheckStatus) -> str:
        # Mapping of the profile's status to that of the state machine.
        mapped = {OK: "OK", LOST: "OK", ERROR: "ERROR", NOTHING: "NONEWDATA"}.get(status, "OTHER")
        if self.state == "NODATA":
            if mapped not in ("ERROR", "NONEWDATA"):
                self.state = "INIT"
            return self.state
        self.window.append(mapped)
        sizes = {"INIT": 0, "VALID": 1, "INVALID": 2}
        place = sizes[self.state]
        size, least, most = (self.config[place + offset] for offset in (0, 3, 6))
        recent = list(self.window)[len(self.window) - size :]
        errors, good = recent.count("ERROR"), recent.count("OK")
        may_be_valid = errors <= most and good >= least
        if self.state == "INIT":
            self.state = "VALID" if may_be_valid else "INVALID" if errors > most else "INIT"
        else:
            self.state = "VALID" if may_be_valid else "INVALID"
        return self.state


NAMES = {
    LinkState.NO_DATA: "NODATA",
    LinkState.INIT: "INIT",
    LinkState.VALID: "VALID",
    LinkState.INVALID: "INVALID",
}


@pytest.mark.parametrize("modulus", MODULI)
def test_every_pair_of_counters_has_the_status_of_the_specification(modulus: int) -> None:
    for last in range(modulus):
        counter = last
        for steps_ahead in range(modulus):  # by counting, not by subtraction
            expected = (
                REPEATED if steps_ahead == 0
                else OK if steps_ahead == 1
                else LOST if steps_ahead <= MAX_DELTA_COUNTER
                else WRONG
            )  # fmt: skip
            assert check_counter(counter, last, modulus) is expected
            counter = 0 if counter == modulus - 1 else counter + 1


@pytest.mark.parametrize("modulus", MODULI)
def test_of_two_senders_in_turn_every_second_frame_at_least_is_refused(modulus: int) -> None:
    for offset in range(2, modulus - 1):
        first, second = 0, offset
        refused = 0
        for _ in range(8):
            refused += not check_counter(second, first, modulus).is_ok
            first = (first + 1) % modulus
            refused += not check_counter(first, second, modulus).is_ok
            second = (second + 1) % modulus
        assert refused >= 8


def test_a_counter_that_goes_back_by_any_step_is_a_wrong_sequence() -> None:
    for back in range(1, 128 - MAX_DELTA_COUNTER):
        assert check_counter((100 - back) % 128, 100, 128) is WRONG


@pytest.mark.parametrize("config", [LINK, TIGHT])
def test_every_sequence_of_six_statuses_leads_to_the_states_of_the_oracle(
    config: LinkConfig,
) -> None:
    for statuses in product((OK, REPEATED, ERROR, NOTHING), repeat=6):
        link, oracle = Link(config), Oracle(config)
        for status in (OK, OK, *statuses):
            link.add(status)
            assert NAMES[link.state] == oracle.check(status)


@pytest.mark.parametrize("config", [LINK, TIGHT])
@pytest.mark.parametrize("damage", [0.02, 0.2, 0.6])
def test_long_random_sequences_lead_to_the_states_of_the_oracle(
    config: LinkConfig, damage: float
) -> None:
    rng = Random(7)
    link, oracle = Link(config), Oracle(config)
    seen = set()
    for _ in range(20_000):
        status = rng.choice(list(CheckStatus)) if rng.random() < damage else OK
        link.add(status)
        assert NAMES[link.state] == oracle.check(status)
        seen.add(link.state)
    assert LinkState.VALID in seen
    assert (LinkState.INVALID in seen) is (damage > 0.1)


@pytest.mark.parametrize("config", [LINK, TIGHT])
def test_the_configurations_obey_the_constraints_of_the_specification(config: LinkConfig) -> None:
    assert config.window_valid >= max(config.window_init, config.window_invalid)
    assert 1 <= config.min_ok_valid <= config.min_ok_init <= config.min_ok_invalid
    assert config.max_error_valid >= config.max_error_init >= config.max_error_invalid >= 0
    for window, ok, error in zip(config[:3], config[3:6], config[6:], strict=True):
        assert ok + error <= window
