"""CAN logs in BLF, ASC and candump format are decoded with a DBC."""

import can
import numpy as np
import pytest

from offline.logs.readers.can_log import read_can
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.mapping.tables import CanSettings

DBC = """VERSION ""
BU_: ECU
BO_ 256 MOTION: 8 ECU
 SG_ Speed : 0|16@1+ (0.01,0) [0|300] "km/h" ECU
 SG_ YawRate : 16|16@1- (0.01,0) [-180|180] "deg/s" ECU
BO_ 512 WHEEL: 4 ECU
 SG_ Angle : 0|16@1- (0.1,0) [-900|900] "deg" ECU
 SG_ Counter : 16|8@1+ (1,0) [0|255] "" ECU
BO_ 768 OTHER: 4 ECU
 SG_ Counter : 0|8@1+ (1,0) [0|255] "" ECU
"""


def frames(count=60):
    """MOTION every 10 ms, WHEEL every 20 ms, and frames that no column needs."""
    for k in range(count):
        speed, yaw = 5000 + k, k - 30
        data = speed.to_bytes(2, "little") + yaw.to_bytes(2, "little", signed=True) + bytes(4)
        yield can.Message(
            timestamp=1000.0 + 0.01 * k,
            arbitration_id=256,
            data=data,
            is_extended_id=False,
            channel=1,
        )
        if k % 2 == 0:
            angle = (-k).to_bytes(2, "little", signed=True) + bytes([k, 0])
            yield can.Message(
                timestamp=1000.002 + 0.01 * k,
                arbitration_id=512,
                data=angle,
                is_extended_id=False,
                channel=1,
            )
        yield can.Message(
            timestamp=1000.003 + 0.01 * k, arbitration_id=0x7DF, data=bytes(8), channel=1
        )


@pytest.fixture
def settings(tmp_path):
    dbc = tmp_path / "car.dbc"
    dbc.write_text(DBC)
    return CanSettings(dbc=dbc)


def write_log(path, messages):
    with can.Logger(path) as writer:
        for message in messages:
            writer(message)
    return path


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log"])
def test_signals_have_the_time_stamps_of_their_frames(tmp_path, settings, suffix):
    path = write_log(tmp_path / f"a{suffix}", frames())
    log = read_can(
        path,
        (
            ("Speed",),
            ("WHEEL.Angle",),
        ),
        settings,
    )
    speed, angle = log.channel("Speed"), log.channel("WHEEL.Angle")
    np.testing.assert_allclose(speed.values, 50.0 + 0.01 * np.arange(60))
    np.testing.assert_allclose(np.diff(speed.t_s), 0.01, atol=2e-4)
    np.testing.assert_allclose(angle.values, -0.1 * np.arange(0, 60, 2))
    assert (speed.unit, angle.unit) == ("km/h", "deg")
    assert angle.t_s[0] - speed.t_s[0] == pytest.approx(0.002, abs=2e-4)


def test_a_signal_of_two_messages_needs_the_name_of_the_message(tmp_path, settings):
    path = write_log(tmp_path / "a.blf", frames())
    with pytest.raises(ConfigError, match=r"WHEEL\.Counter, OTHER\.Counter"):
        read_can(path, (("Counter",),), settings)


def test_an_unknown_signal_is_refused_with_similar_ones(tmp_path, settings):
    path = write_log(tmp_path / "a.blf", frames())
    with pytest.raises(ConfigError, match=r"'yawrate'.*Did you mean YawRate"):
        read_can(path, (("yawrate",),), settings)


def test_a_message_that_is_never_on_the_bus_is_refused_with_its_name(tmp_path, settings):
    path = write_log(tmp_path / "a.blf", frames())
    with pytest.raises(DatasetError, match=r"column OTHER\.Counter: expected frames of OTHER"):
        read_can(path, (("OTHER.Counter",),), settings)


def test_frames_of_other_channels_are_ignored(tmp_path, settings):
    path = write_log(tmp_path / "a.blf", frames())
    elsewhere = settings.model_copy(update={"channel": 7})
    with pytest.raises(DatasetError, match="on channel 7"):
        read_can(path, (("Speed",),), elsewhere)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.6, 0.97])
def test_a_truncated_blf_is_refused(tmp_path, settings, share):
    path = write_log(tmp_path / "a.blf", frames())
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(DatasetError, match=r"a\.blf.*truncated"):
        read_can(path, (("Speed",),), settings)


@pytest.mark.parametrize("suffix", [".asc", ".log", ".trc"])
@pytest.mark.parametrize("share", [0.5, 0.7, 0.93])
def test_a_truncated_text_log_is_refused(tmp_path, settings, suffix, share):
    path = write_log(tmp_path / f"a{suffix}", frames())
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))].rstrip(b"\r\n"))
    with pytest.raises(DatasetError, match="truncated"):
        read_can(path, (("Speed",),), settings)


def test_an_asc_without_its_last_line_is_refused(tmp_path, settings):
    path = write_log(tmp_path / "a.asc", frames())
    path.write_bytes(path.read_bytes().replace(b"End TriggerBlock\n", b""))
    with pytest.raises(DatasetError, match="a last line 'End TriggerBlock'"):
        read_can(path, (("Speed",),), settings)


def test_a_frame_shorter_than_its_message_is_refused_with_its_number(tmp_path, settings):
    path = tmp_path / "a.log"
    path.write_text("(1.000000) can0 100#8813E20000000000\n(1.010000) can0 100#88\n")
    with pytest.raises(DatasetError, match=r"a\.log, column Speed, frame 2: expected 8 bytes"):
        read_can(path, (("Speed",),), settings)


def test_a_candump_that_ends_inside_a_line_is_refused(tmp_path, settings):
    path = tmp_path / "a.log"
    path.write_text("(1.000000) can0 100#8813E20000000000\n(1.0100")
    with pytest.raises(DatasetError, match="truncated"):
        read_can(path, (("Speed",),), settings)


def test_a_log_without_a_dbc_is_refused(tmp_path):
    path = write_log(tmp_path / "a.blf", frames())
    with pytest.raises(DatasetError, match=r"\[can\] dbc"):
        read_can(path, (("Speed",),), None)


def test_a_file_that_is_not_a_dbc_is_refused_with_its_name(tmp_path):
    dbc = tmp_path / "car.dbc"
    dbc.write_text("BO_ nonsense")
    path = write_log(tmp_path / "a.blf", frames())
    with pytest.raises(ConfigError, match=r"car\.dbc: expected a DBC"):
        read_can(path, (("Speed",),), CanSettings(dbc=dbc))
