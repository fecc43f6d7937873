"""What counts only with a second message: ends of missions, other catalogues, commands."""

import pytest
from made_frames import CONTROL, ENGAGED

from rt_controller.bus.identity import (
    DISENGAGED_FRAMES,
    MISMATCHED_FRAMES,
    Engagement,
    PeerCatalogue,
    is_heartbeat_of,
    own_identity,
)
from rt_controller.bus.messages import Command, Heartbeat, Identity, Mission
from rt_controller.bus.receive import Received
from rt_controller.contract.faults import Fault
from rt_controller.contract.signals import Mode

OVER = ENGAGED._replace(is_engaged=False)
OTHER = Identity(1, None)


def confirmed(script: str) -> list[bool]:
    """For each received mission, E engaged and . over: whether the controller is to drive."""
    engagement = Engagement()
    answers = []
    for place, letter in enumerate(script):
        content: Mission = ENGAGED if letter == "E" else OVER
        received = Received(content, place, place)
        for _ in range(4):  # the same one in each period
            answer = engagement.confirmed(received)
        answers.append(answer)
    return answers


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ("EEEE", "EEEE"),
        ("....", "...."),  # never engaged
        ("EE.EE", "EEEEE"),
        ("EE..E..E", "EEEEEEEE"),
        ("E...E", "EEE.E"),
        (".E", ".E"),
    ],
)
def test_a_mission_ends_after_several_frames_in_a_row(script: str, expected: str) -> None:
    assert confirmed(script) == [letter == "E" for letter in expected]
    assert DISENGAGED_FRAMES == 3


def test_another_catalogue_is_that_of_several_identities_in_a_row() -> None:
    peer = PeerCatalogue(is_fd=False)
    assert not peer.is_another(None)
    for place, (identity, is_another) in enumerate(
        [
            (OTHER, False),
            (own_identity(None), False),
            (OTHER, False),
            (OTHER, True),
            (own_identity(None), False),
        ]
    ):
        received = Received(identity, place, place)
        assert peer.is_another(received) is is_another
        assert peer.is_another(received) is is_another
    assert MISMATCHED_FRAMES == 2


@pytest.mark.parametrize(
    ("counter", "state_counter", "mode", "expected"),
    [
        (5, 5, Mode.NOMINAL, True),
        (5, 21, Mode.NOMINAL, True),
        (5, 117, Mode.NOMINAL, True),
        (4, 5, Mode.NOMINAL, False),
        (6, 5, Mode.NOMINAL, False),
        (5, 4, Mode.NOMINAL, False),
        (5, 6, Mode.NOMINAL, False),
        (5, 5, Mode.SAFE_STOP, False),
    ],
)
def test_a_heartbeat_belongs_to_the_command_of_its_counter_state_and_mode(
    counter: int, state_counter: int, mode: Mode, expected: bool
) -> None:
    heartbeat = Heartbeat(mode, Fault(0), state_counter, 0, 0, 1)
    found = is_heartbeat_of(
        Received(heartbeat, counter, 0), Received(Command(CONTROL, Mode.NOMINAL), 5, 0)
    )
    assert found is expected
