"""Signals as they are in databases of real cars: switches, compass headings, converted units."""

from math import isnan, pi

import cantools
import pytest

from rt_controller.contract.errors import DatasetError
from rt_controller.mapping.signal_frames import SignalReader, SignalWriter
from rt_controller.mapping.slots import Slot
from rt_controller.mapping.tables import ColumnMapping, SwitchMapping

DBC = """VERSION ""
BU_: CAR PC
BO_ 16 Status: 8 CAR
 SG_ State : 0|3@1+ (1,0) [0|7] "" PC
 SG_ Heading : 8|16@1+ (0.01,0) [0|359.99] "deg" PC
 SG_ Pressure : 24|12@1+ (0.1,0) [0|250] "bar" PC
 SG_ Pedal : 40|8@1+ (0.5,0) [0|100] "" PC
VAL_ 16 State 0 "Off" 1 "Ready" 2 "Active" 6 "Fault" 7 "SNA" ;
"""
ANY = (float("-inf"), float("inf"))


def both_ways(slot, value):
    """What is read of a value that was written."""
    database = cantools.database.load_string(DBC, "dbc")
    (frame,) = SignalWriter([slot], {}, database, "car").frames({slot.name: value}, 0)
    found = SignalReader([slot], {}, database, "car").read(frame)[slot.name]
    return database.decode_message(16, bytes(frame.data), decode_choices=False), found


def switch(*on):
    column = SwitchMapping(column="State", on=on)
    return Slot("mission.engage", column, "1", ANY, frozenset(on))


def test_a_switch_is_on_at_its_values_only():
    database = cantools.database.load_string(DBC, "dbc")
    reader, message = SignalReader([switch(2, 3)], {}, database, "car"), database.messages[0]
    found = []
    for raw in range(8):
        (frame,) = SignalWriter([switch(raw)], {}, database, "car").frames(
            {"mission.engage": 1.0}, 0
        )
        found.append(reader.read(frame)["mission.engage"])
    assert message.get_signal_by_name("State").choices[7] == "SNA"
    assert found[:7] == [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    assert isnan(found[7])


@pytest.mark.parametrize(("on", "off"), [((2, 3), 0), ((0,), 1)])
def test_a_simulated_car_sends_a_switch_with_its_values(on, off):
    assert both_ways(switch(*on), 1.0)[0]["State"] == min(on)
    assert both_ways(switch(*on), 0.0)[0]["State"] == off


@pytest.mark.parametrize("yaw_rad", [-3.0, -0.5, 0.0, 1.0, 2.1, 7.0])
def test_a_compass_heading_is_sent_in_the_range_of_its_signal(yaw_rad):
    """Clockwise from north, 0 to 360 deg."""
    column = ColumnMapping(column="Heading", unit="deg", sign=-1, offset=-90.0)
    sent, found = both_ways(Slot("pose.yaw", column, "rad", ANY), yaw_rad)
    assert sent["Heading"] == pytest.approx((90.0 - yaw_rad * 180.0 / pi) % 360.0, abs=0.006)
    assert (found - yaw_rad + 0.1) % (2.0 * pi) == pytest.approx(0.1, abs=1e-4)


def test_a_factor_converts_to_another_quantity():
    column = ColumnMapping(column="Pressure", unit="N", factor=3.0)
    sent, found = both_ways(Slot("commands.brake_n", column, "N", ANY), 60.0)
    assert sent["Pressure"] == pytest.approx(20.0)
    assert found == pytest.approx(60.0)


@pytest.mark.parametrize(
    ("unit", "factor", "si", "hint"),
    [("N", 1.0, "N", "factor that converts bar to N"), ("kPa", 2.0, "Pa", "Correct the unit")],
)
def test_another_unit_than_that_of_the_dbc_is_refused(unit, factor, si, hint):
    column = ColumnMapping(column="Pressure", unit=unit, factor=factor)
    with pytest.raises(DatasetError, match=hint):
        both_ways(Slot("commands.brake_n", column, si, ANY), 1.0)


def test_a_signal_without_a_unit_in_the_dbc_has_that_of_the_mapping():
    column = ColumnMapping(column="Pedal", unit="%")
    sent, found = both_ways(Slot("commands.throttle", column, "1", ANY), 0.25)
    assert sent["Pedal"] == 25.0
    assert found == pytest.approx(0.25)
