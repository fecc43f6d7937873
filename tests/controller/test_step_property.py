"""For any sequence of received data, every command is within its limits."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
from scripted_vehicle import CRUISING, STRAIGHT, VALID_NS, build_rig

from rt_controller.bus.messages import Mission
from rt_controller.contract.limits import INPUT_LIMITS
from rt_controller.contract.signals import ControlInput, Mode
from rt_controller.contract.timing import HOLD_PLAN_TICKS, PERIOD_S
from rt_controller.control.mpc import Mpc

speeds = st.sampled_from([CRUISING, CRUISING._replace(vx_mps=0.0), CRUISING._replace(ey_m=8.0)])
broken = st.sampled_from([None, CRUISING._replace(vy_mps=math.nan)])
states = st.one_of(speeds, speeds, broken)
paths = st.sampled_from(
    [STRAIGHT, STRAIGHT._replace(c0_m=3.0, c1=0.3), STRAIGHT._replace(v_mps=0.0), None]
)
missions = st.one_of(
    st.builds(Mission, st.booleans(), st.booleans(), st.just(1), st.just(VALID_NS)), st.none()
)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(states, paths, missions), min_size=1, max_size=30))
def test_every_command_is_within_bounds_slew_limited_and_on_one_pedal(
    mpc_of_session: Mpc, script: list
) -> None:
    with build_rig(mpc_of_session) as rig:
        held = 0
        for rig.vehicle.state, rig.vehicle.path, rig.vehicle.mission in script:
            previous, was = rig.step.last.control, rig.step.last.mode
            result = rig.tick()
            assert_within_limits(result.control, previous)
            held = held + 1 if result.mode is Mode.HOLD_PLAN else 0
            assert held <= HOLD_PLAN_TICKS
            if result.mode is Mode.SAFE_STOP:
                assert result.control.throttle == 0.0
            if was is Mode.SAFE_STOP and result.mode is not Mode.SAFE_STOP:
                assert rig.vehicle.mission is not None
                assert rig.vehicle.mission.is_reset_requested


def assert_within_limits(control: ControlInput, previous: ControlInput) -> None:
    rate = INPUT_LIMITS.rate_per_s
    for value, low, high in zip(control, INPUT_LIMITS.lower, INPUT_LIMITS.upper, strict=True):
        assert math.isfinite(value)
        assert low <= value <= high
    assert control.throttle == 0.0 or control.brake_n == 0.0
    assert control.throttle - previous.throttle <= rate.throttle * PERIOD_S + 1e-9
    # A brake force below one thousandth of the pedal's travel is sent as 0.
    assert abs(control.brake_n - previous.brake_n) <= rate.brake_n * PERIOD_S + 0.15
    assert abs(control.steer_rad - previous.steer_rad) <= rate.steer_rad * PERIOD_S + 1e-9
