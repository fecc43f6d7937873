"""The curvature ahead in a control step: when it is used, and that its loss stops nothing."""

from typing import Any

import pytest
from made_frames import BEND
from scripted_vehicle import Rig

from rt_controller.bus.messages import PREVIEW
from rt_controller.contract.faults import Fault
from rt_controller.contract.signals import CurvaturePreview, Mode
from rt_controller.control.program import SolveStatus


def previews_of(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> list[CurvaturePreview | None]:
    """A list that every plan adds its preview to."""
    seen: list[CurvaturePreview | None] = []
    plan = rig.mpc.plan

    def watched(*arguments: Any) -> SolveStatus:
        seen.append(arguments[4])
        return plan(*arguments)

    monkeypatch.setattr(rig.mpc, "plan", watched)
    return seen


def test_a_vehicle_that_sends_no_preview_is_driven_at_constant_curvature(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = previews_of(rig, monkeypatch)
    result = rig.tick(5)
    assert seen == [None] * 5
    assert result.mode is Mode.NOMINAL
    assert rig.heartbeat.faults == 0


def test_a_preview_is_used_for_three_periods_and_its_loss_stops_nothing(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig.tick(3)
    rig.vehicle.preview = BEND
    rig.tick()  # the first frames are not used yet
    seen = previews_of(rig, monkeypatch)
    rig.tick()
    rig.vehicle.preview = None
    assert rig.tick(5).mode is Mode.NOMINAL
    assert seen == [pytest.approx(BEND)] * 4 + [None] * 2
    assert rig.heartbeat.faults == 0


@pytest.mark.parametrize("damaged_byte", [0, 5])
def test_a_damaged_preview_is_not_used(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, damaged_byte: int
) -> None:
    codec = PREVIEW.codecs[1]
    write = codec.write

    def damage(*arguments: Any) -> bytes:
        damaged = bytearray(write(*arguments))
        damaged[damaged_byte] ^= 0x10
        return bytes(damaged)

    monkeypatch.setattr(codec, "write", damage)
    rig.vehicle.preview = BEND
    seen = previews_of(rig, monkeypatch)
    assert rig.tick(3).mode is Mode.NOMINAL
    assert seen == [None] * 3
    assert rig.inbox.counts.crc_errors == 3


def test_a_preview_marked_invalid_is_no_fault(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """A vehicle without a map may send its frames so."""
    rig.vehicle.after_sending = lambda now_ns: rig.vehicle.outbox.send(
        PREVIEW, BEND, now_ns, is_valid=False
    )
    seen = previews_of(rig, monkeypatch)
    assert rig.tick(3).mode is Mode.NOMINAL
    assert seen == [None] * 3
    assert rig.heartbeat.faults == 0


def test_a_preview_that_contradicts_the_state_is_not_used_and_is_reported(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    circle = CurvaturePreview(3.0, *[0.005] * 5)  # the state has the curvature 0
    rig.vehicle.preview = circle
    rig.tick()  # the first frames are not used yet
    seen = previews_of(rig, monkeypatch)
    for _ in range(3):
        result = rig.tick()
        assert result.mode is Mode.NOMINAL
        assert rig.heartbeat.faults == result.faults == Fault.PREVIEW_IMPLAUSIBLE
    rig.vehicle.preview = BEND
    assert rig.tick().faults == rig.heartbeat.faults == 0
    assert seen == [None] * 3 + [pytest.approx(BEND)]
    rig.vehicle.preview, rig.vehicle.state = circle, None
    rig.tick()
    assert rig.heartbeat.faults == Fault.STATE_STALE  # nothing to compare with
