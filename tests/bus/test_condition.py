"""What error frames of SocketCAN and failures of the interface say about the bus."""

import errno

import can
import pytest

from rt_controller.bus.condition import BusCondition, BusState, is_queue_full


def error_frame(classes: int, detail: int = 0) -> can.Message:
    return can.Message(
        arbitration_id=classes,
        is_extended_id=False,
        is_error_frame=True,
        data=bytes((0, detail, 0, 0, 0, 0, 0, 0)),
    )


@pytest.mark.parametrize(
    ("classes", "detail", "state"),
    [
        (0x004, 0x04, BusState.WARNING),
        (0x004, 0x08, BusState.WARNING),
        (0x004, 0x10, BusState.PASSIVE),
        (0x004, 0x20, BusState.PASSIVE),
        (0x204, 0x0C | 0x30, BusState.PASSIVE),
        (0x040, 0x00, BusState.BUS_OFF),
        (0x0C8, 0x00, BusState.BUS_OFF),
        (0x008, 0x3C, BusState.ACTIVE),
        (0x020, 0x00, BusState.ACTIVE),
    ],
)
def test_an_error_frame_gives_the_state(classes: int, detail: int, state: BusState) -> None:
    condition = BusCondition()
    condition.note_error_frame(error_frame(classes, detail))
    assert condition.state is state
    assert condition.error_frames == 1
    assert state.is_disturbed == (state not in (BusState.ACTIVE, BusState.WARNING))
    assert condition.bus_off == (state is BusState.BUS_OFF)


@pytest.mark.parametrize(
    ("frames", "state", "counts"),
    [
        (((0x040, 0), (0x100, 0)), BusState.ACTIVE, {"bus_off": 1, "restarts": 1}),
        (((0x004, 0x20), (0x004, 0x40)), BusState.ACTIVE, {}),
        (((0x004, 0x01),), BusState.ACTIVE, {"controller_overflows": 1}),
        (((0x004, 0x02),), BusState.ACTIVE, {"controller_overflows": 1}),
        (((0x004, None),), BusState.ACTIVE, {}),
    ],
)
def test_recoveries_overflows_and_frames_without_data_are_counted(
    frames: tuple[tuple[int, int | None], ...], state: BusState, counts: dict[str, int]
) -> None:
    condition = BusCondition()
    for classes, detail in frames:
        frame = error_frame(classes, detail or 0)
        if detail is None:
            frame.data = bytearray()
        condition.note_error_frame(frame)
    assert condition == BusCondition(state, error_frames=len(frames), **counts)


def test_an_interface_that_is_down_is_no_failure_and_recovers_with_the_next_frame() -> None:
    condition = BusCondition()
    assert condition.note_failure(can.CanOperationError("Network is down", errno.ENETDOWN))
    assert (condition.state, condition.link_downs) == (BusState.DOWN, 1)
    condition.note_frame()
    assert condition.state is BusState.ACTIVE


@pytest.mark.parametrize("number", [errno.ENODEV, errno.EBADF, None])
def test_any_other_failure_is_one(number: int | None) -> None:
    condition = BusCondition()
    assert not condition.note_failure(can.CanOperationError("gone", number))
    assert condition == BusCondition()


def test_a_full_queue_is_distinguished_from_other_failures() -> None:
    assert is_queue_full(can.CanOperationError("No buffer space available", errno.ENOBUFS))
    assert is_queue_full(can.CanOperationError("Transmit buffer full"))
    assert not is_queue_full(can.CanOperationError("Network is down", errno.ENETDOWN))
