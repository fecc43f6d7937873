"""A new message is a frame in the DBC, one definition and one call."""

from pathlib import Path

import pytest

from rt_controller.bus.codec import FrameSpec
from rt_controller.bus.dbc import DBC_PATH
from rt_controller.bus.messages import Catalogue, Message, Node
from rt_controller.bus.receive import Inbox
from rt_controller.bus.send import Outbox
from rt_controller.bus.transport import open_bus
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.timing import PERIOD_MS

TRIAL_DBC = """
BO_ 2047 TRIAL: 8 VEHICLE
 SG_ Crc : 0|8@1+ (1,0) [0|255] "" CONTROLLER
 SG_ Counter : 8|4@1+ (1,0) [0|15] "" CONTROLLER
 SG_ Valid : 12|1@1+ (1,0) [0|1] "" CONTROLLER
 SG_ Cycle : 13|3@1+ (1,0) [0|7] "" CONTROLLER
 SG_ Voltage : 16|16@1+ (0.01,0) [0|600] "V" CONTROLLER
 SG_ Temperature : 32|8@1- (1,0) [-40|120] "degC" CONTROLLER

CM_ "The bus"""
TRIAL_ATTRIBUTES = """
BA_ "GenMsgCycleTime" BO_ 2047 250;
BA_ "E2EDataIdList" BO_ 2047 "00 01 02 03 04 05 06 07 08 09 0A 0B 0C 0D 0E 0F";

VAL_ 2047 Voltage 65535 "NotAvailable" ;
VAL_ 2047 Temperature -128 "NotAvailable" ;
VAL_ 256 Mode"""
TRIAL_FRAME = FrameSpec("TRIAL", "Valid", ("Voltage", "Temperature"))


@pytest.fixture
def catalogue(tmp_path: Path) -> Catalogue:
    text = DBC_PATH.read_text(encoding="ascii")
    path = tmp_path / "messages.dbc"
    path.write_text(
        text.replace('\nCM_ "The bus', TRIAL_DBC, 1).replace(
            "\nVAL_ 256 Mode", TRIAL_ATTRIBUTES, 1
        ),
        encoding="ascii",
    )
    return Catalogue(path)


def define_trial(catalogue: Catalogue) -> Message[tuple[float, float]]:
    return catalogue.define(
        TRIAL_FRAME,
        cycle_ticks=10,
        encode=lambda content: content,
        decode=lambda voltage_v, temperature_degc: (voltage_v, temperature_degc),
    )


def test_a_message_of_an_extended_dbc_is_sent_and_received(catalogue: Catalogue) -> None:
    trial = define_trial(catalogue)
    inbox = Inbox(Node.CONTROLLER, catalogue=catalogue)
    with open_bus("virtual", "trial") as near, open_bus("virtual", "trial") as far:
        outbox = Outbox(far, Node.VEHICLE, catalogue=catalogue)
        for now_ns in range(3):
            outbox.send(trial, (398.5, 21.0 + now_ns), now_ns)
        inbox.drain(near, 7)
    newest = inbox.newest(trial)
    assert newest is not None
    assert newest.content == pytest.approx((398.5, 23.0))
    assert (newest.counter, newest.arrival_ns) == (2, 7)
    assert trial.sender is Node.VEHICLE
    assert trial.cycle_ms == 10 * PERIOD_MS


def test_frames_of_different_senders_make_no_message(catalogue: Catalogue) -> None:
    command = FrameSpec("ACT_CMD", "Mode", ("Throttle", "BrakeForce", "SteeringWheelAngle"))
    with pytest.raises(ConfigError, match="ACT_CMD, TRIAL with one sender"):
        catalogue.define(command, TRIAL_FRAME, cycle_ticks=1, encode=tuple, decode=tuple)
