"""A row of the history is a state and the input that followed it, without gaps."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rt_controller.contract.signals import ControlInput, VehicleState
from rt_controller.control.lift import History
from rt_controller.model.validation import DRIVABLE_HISTORY

STEPS = 4


def state(k: int) -> VehicleState:
    return VehicleState(20.0 + k, 0.1 * k, -0.01 * k, 0.5, 7.0, 7.0)


def held(k: int) -> ControlInput:
    """The input from instant k to the next."""
    return ControlInput(0.01 * k, 1.0 * k, -0.1 * k)


def row(x: VehicleState, u: ControlInput) -> tuple[float, ...]:
    named = {**x._asdict(), **u._asdict()}
    return tuple(named[name] for name in DRIVABLE_HISTORY)


def memory() -> np.ndarray:
    return np.full((STEPS, len(DRIVABLE_HISTORY)), np.nan, dtype=np.float32)


def as_float32(rows: list[tuple[float, ...]]) -> np.ndarray:
    return np.array(rows, dtype=np.float32)


def test_a_row_is_a_state_and_the_input_that_acted_from_it() -> None:
    rows = memory()
    history = History(rows)
    for k in range(10):
        history.advance(state(k), held(k - 1))
    expected = [row(state(k), held(k)) for k in (5, 6, 7, 8)]
    np.testing.assert_array_equal(rows, as_float32(expected))


def test_before_the_oldest_state_the_rows_repeat_it_with_the_input_then_in_force() -> None:
    rows = memory()
    history = History(rows)
    history.advance(state(0), held(-1))
    before = row(state(0), held(-1))
    np.testing.assert_array_equal(rows, as_float32([before] * 4))
    history.advance(state(1), held(0))
    np.testing.assert_array_equal(rows, as_float32([before] * 3 + [row(state(0), held(0))]))
    for k in (2, 3, 4):
        history.advance(state(k), held(k - 1))
    np.testing.assert_array_equal(rows, as_float32([row(state(k), held(k)) for k in range(4)]))


def test_forgotten_rows_do_not_come_back() -> None:
    rows = memory()
    history = History(rows)
    for k in range(6):
        history.advance(state(k), held(k - 1))
    history.forget()
    assert not history.is_begun
    history.advance(state(8), held(7))
    assert history.is_begun
    np.testing.assert_array_equal(rows, as_float32([row(state(8), held(7))] * 4))


@given(st.lists(st.booleans(), min_size=1, max_size=40), st.integers(1, 6))
def test_all_rows_were_observed_since_the_last_gap(is_seen: list[bool], steps: int) -> None:
    """Compared with the definition, written with a list."""
    rows = np.full((steps, len(DRIVABLE_HISTORY)), np.nan, dtype=np.float32)
    history = History(rows)
    begun_at: int | None = None
    for k, seen in enumerate(is_seen):
        if not seen:
            history.forget()
            begun_at = None
            continue
        history.advance(state(k), held(k - 1))
        if begun_at is None:
            begun_at = k
        since = [row(state(j), held(j)) for j in range(begun_at, k)]
        before = [row(state(begun_at), held(begun_at - 1))] * steps
        np.testing.assert_array_equal(rows, as_float32((before + since)[-steps:]))
