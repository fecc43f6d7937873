"""A new tick has received nothing, and nothing is planned or decided in it."""

from dataclasses import fields

from rt_controller.contract.faults import NO_FAULT, StopCause
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import NEUTRAL_INPUT, Mode
from rt_controller.safety.fallback import Braking
from rt_controller.safety.tick import Estimate, Tick


def test_nothing_is_received_planned_or_decided_in_a_new_tick() -> None:
    tick = Tick()
    values = {field.name: getattr(tick, field.name) for field in fields(tick)}
    true = {name for name, value in values.items() if value is True}
    assert true == {"is_answered"}
    assert (tick.periods, tick.late_ticks, tick.periods_held) == (1, 0, 0)
    assert (tick.qp_iterations, tick.qp_ns, tick.curvature_per_m) == (0, 0, 0.0)
    assert {tick.mode, tick.last_mode, tick.law} == {Mode.STANDBY}
    assert (tick.cause, tick.bus_fault) == (StopCause.NONE, StopCause.NONE)
    assert (tick.state_loss, tick.faults) == (StopCause.STATE_LOST, NO_FAULT)
    assert (tick.control, tick.limits) == (NEUTRAL_INPUT, INPUT_LIMITS)
    nothing = Estimate(None, 0.0, None, None, False, False, None, StopCause.NONE, StopCause.NONE)
    assert tick.estimate == nothing == Estimate()
    received = (tick.state, tick.path, tick.preview, tick.feedback, tick.applied, tick.planned)
    assert received == (None,) * 6
    assert not hasattr(tick, "__dict__")


def test_a_mode_says_whether_the_car_was_driven_and_is_stopping() -> None:
    for mode in Mode:
        tick = Tick(last_mode=mode)
        assert tick.is_driven == (mode is not Mode.STANDBY)
        assert tick.is_stopping == (mode is Mode.SAFE_STOP)


def test_a_braking_is_scaled_by_the_force_of_the_car() -> None:
    usual = Braking(20.0, 150.0)
    assert usual.scaled(0.5) == (10.0, 75.0)
    assert usual.scaled(2.0) == (40.0, 300.0)
    assert usual.scaled(1.0) == usual
