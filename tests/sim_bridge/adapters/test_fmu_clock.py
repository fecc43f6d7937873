"""An FMU on a grid of its own: every instant is covered, no input comes from the future."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rt_controller.contract.timing import PERIOD_S
from sim_bridge.adapters.fmu_clock import FmuClock

N_PERIODS = 30


@given(step_s=st.floats(2e-4, 0.3))
def test_every_instant_lies_in_the_last_step_and_inputs_are_not_from_the_future(
    step_s: float,
) -> None:
    clock = FmuClock(step_s)
    n_steps, slack_s = 0, 1e-3 * step_s
    for period in range(N_PERIODS):
        n_points = clock.points_in(PERIOD_S)
        for i in range(n_points):
            time_s = clock.period_start_s + (i + 1) * PERIOD_S / n_points
            while clock.is_before(time_s):
                # The input of this period begins with it; before, that of the last one holds.
                begin_s = period * PERIOD_S
                assert clock.is_in_past == (clock.fmu_s < begin_s - slack_s)
                assert clock.fmu_s >= begin_s - step_s - slack_s
                clock.count_step()
                n_steps += 1
            share = clock.share_of_step(time_s)
            assert 0.0 <= share <= 1.0
            last_s = clock.fmu_s - step_s + share * step_s
            assert last_s == pytest.approx(time_s, abs=2.0 * slack_s)
        clock.end_period(PERIOD_S)
    assert n_steps * step_s == pytest.approx(N_PERIODS * PERIOD_S, abs=step_s + 2.0 * slack_s)


@pytest.mark.parametrize("n_steps", [1, 2, 5, 25])
def test_steps_that_are_parts_of_the_period_end_with_it(n_steps: int) -> None:
    clock = FmuClock(PERIOD_S / n_steps)
    for _ in range(1000):
        assert clock.points_in(PERIOD_S) == n_steps
        for i in range(n_steps):
            time_s = clock.period_start_s + (i + 1) * PERIOD_S / n_steps
            assert clock.is_before(time_s)
            assert not clock.is_in_past
            clock.count_step()
            assert clock.share_of_step(time_s) == 1.0
        clock.end_period(PERIOD_S)
