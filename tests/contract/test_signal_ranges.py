"""The ranges that are checked without a bus are those of its signals."""

import pytest

from rt_controller.bus.messages import REFERENCE, STATE, Message
from rt_controller.contract.signal_ranges import (
    LARGEST_PATH,
    LARGEST_STATE,
    SMALLEST_PATH,
    SMALLEST_STATE,
)
from rt_controller.contract.signals import PathReference, VehicleState


@pytest.mark.parametrize(
    ("message", "smallest", "largest"),
    [(STATE, SMALLEST_STATE, LARGEST_STATE), (REFERENCE, SMALLEST_PATH, LARGEST_PATH)],
)
def test_the_ranges_are_those_of_the_message_catalogue(
    message: Message, smallest: VehicleState | PathReference, largest: VehicleState | PathReference
) -> None:
    signals = [signal for codec in message.codecs for signal in codec.signals][: len(smallest)]
    assert [s.raw_min * s.scale + s.offset for s in signals] == pytest.approx(list(smallest))
    assert [s.raw_max * s.scale + s.offset for s in signals] == pytest.approx(list(largest))
