"""Logs of every format are read with times, units and row numbers, or refused with the place."""

import gzip
from contextlib import suppress

import can
import numpy as np
import pyarrow as pa
import pytest
from asammdf import MDF, Signal
from own_car import EXAMPLE, VALUES, example, state_writer
from pyarrow import parquet
from scipy.io import savemat

from offline.logs.mapping import CsvSettings, read_mapping
from offline.logs.readers.formats import read_file
from offline.logs.readers.log import Request
from offline.logs.readers.source import find_logs, read_log
from offline.logs.signal import to_drive
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.gateway.signals_check import check_signals
from rt_controller.mapping.can_log import read_frames
from rt_controller.mapping.car_file import read_car
from rt_controller.mapping.slots import Slot
from rt_controller.mapping.tables import CanSettings, Clock, ColumnMapping

STAMPED = Clock(column="t")
EVERY_10_MS = Clock(period_s=0.01)
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


def read(path, *wanted, clock=STAMPED, can=None, **style):
    names = [(each,) if isinstance(each, str) else each for each in wanted or ("v",)]
    unit = {"OTHER.Counter": "1"}
    columns = [
        ColumnMapping(column=each[0], other_names=each[1:], unit=unit.get(each[0]))
        for each in names
        if can
    ]
    slots = [Slot(f"signals.{each.column}", each, "") for each in columns]
    return read_file(Request(path, names, clock, CsvSettings(**style), can, slots))


@pytest.fixture
def csv(tmp_path):
    """Function that reads the columns of a text."""

    def csv(text, *wanted, **options):
        path = tmp_path / "a.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read(path, *wanted, **options)

    return csv


@pytest.mark.parametrize(
    "text",
    [
        "t,v\n1.0,2.5\n1.5,3.5\n",
        "t;v\n1,0;2,5;\n1,5;3,5;\n",
        "v\tt\n2.5\t1.0\n3.5\t1.5\n",
        "t   v\n1.0 2.5\n 1.5    3.5\n",
        "# t,v\n1.0,2.5\n1.5,3.5\n",
        "% made by a tool\n%\n% t v\n1.0 2.5\n1.5 3.5\n",
        "# made by a tool\nt,v\n1.0,2.5\n1.5,3.5\n",
        "\ufefft , other, v\r\n1.0,7,2.5\r\n\r\n1.5,8,3.5\r\n",
        't,"v"\n"1.0","2.5"\n"1.5","3.5"\n',
        "t\tv\n1.0\t2.5\n1.5\t3.5\n".encode("utf-16"),
    ],
)
def test_delimiter_header_decimals_and_encoding_of_csv_are_detected(csv, text):
    channel = csv(text).column("v")
    assert channel.t_s.tolist() == [0.0, 0.5]
    assert channel.values.tolist() == [2.5, 3.5]


@pytest.mark.parametrize(
    ("text", "column", "clock", "style"),
    [
        ("t v\n0 1\n1 2\n", "v", STAMPED, {"delimiter": " "}),
        ("# a comment\n0 1\n1 2\n", "2", Clock(column="1"), {"header_line": 0}),
        ("1,2\n0,1\n1,2\n", "2", Clock(column="1"), {}),
        ("Logger 7\nt,v\ns,km/h\n0,1\n1,2\n", "v", STAMPED, {"header_line": 2, "units_line": 3}),
        ("t,v,°\n0,1,2\n1,2,3\n".encode("latin-1"), "v", STAMPED, {"encoding": "latin-1"}),
        ("t,v\n0,1\n0,9\n1,2\n", "v", Clock(column="t", repeated="skip"), {}),
        ("v\n1\n2\n", "v", Clock(period_s=1.0), {}),
        ("stamp,v\n0,1\n1,2\n", "v", Clock(column="t", other_names=("time", "stamp")), {}),
        ("t;v\n10:00:59,5;1\n10:01:00,5;2\n", "v", Clock(column="t", unit="hh:mm:ss"), {}),
        ("t,v\n2024-05-01T10:00:00,1\n2024-05-01T10:00:01,2\n",)
        + ("v", Clock(column="t", unit="iso8601"), {}),
    ],
)
def test_settings_say_how_a_csv_file_is_read(csv, text, column, clock, style):
    channel = csv(text, column, clock=clock, **style).column(column)
    assert channel.t_s == pytest.approx([0.0, 1.0])
    assert channel.values.tolist() == [1.0, 2.0]


def test_rows_are_counted_as_an_editor_counts_lines(csv):
    log = csv("Logger 7\nt,v\ns,km/h\n0,36\n\n1,72\n", header_line=2, units_line=3)
    assert log.column("v").row.tolist() == [4, 6]
    assert log.column("v").unit == "km/h"


def test_a_unit_behind_a_name_is_not_part_of_it(csv):
    text = '# t(ms),v [km/h],"w, deg/s",gear (front),x_kmh,a_n\n0,36,1,3,1,1\n500,72,2,4,1,1\n'
    log = csv(text, "v", "w", "gear (front)", "x_kmh", "a_n")
    assert [column.unit for column in log.columns] == ["km/h", "deg/s", "", "km/h", ""]
    assert log.column("w").t_s.tolist() == [0.0, 0.5]


@pytest.mark.parametrize("word", ["", "#N/A", "1.#QNAN", "---", "NaN"])
def test_words_for_no_number_are_missing_numbers(csv, word):
    assert np.isnan(csv(f"t,v\n0,1\n1,{word}\n").column("v").values[1])


def test_a_column_may_have_other_names(csv):
    assert csv("t,speed\n0,5\n1,6\n", ("v", "speed")).column("v", "speed").values[1] == 6.0


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("t,v\n0,1\n1,fast\n", {}, "column v, line 3: expected a number, found 'fast'"),
        ("t,v\n0,1\n1,2,3\n", {}, "line 3: expected 2 cells as in the header, found 3"),
        ("t,v,w\n0,1,2\n1,2", {}, "line 3: expected 3 cells as in the header, found 2"),
        ("t v\n0 1\n1\n", {}, "line 3: expected 2 cells as in the header, found 1"),
        (
            "t,v\n0,1\n2,2\n1,3\n",
            {},
            "column v, line 4: expected time to increase, found 1",
        ),
        ("t,v\n0,1\n0,2\n", {}, "column v, line 3: expected time to increase"),
        ("t,v\n0,1\n,2\n", {}, "column t, line 3: expected a time, found none"),
        ("t,v\n0,1\n", {}, "at least two rows"),
        ("", {}, "a header in line 1"),
        ("t,Veh\n0,1\n1,2\n", {}, "expected a column 'v', found none"),
        ("t,V\n0,1\n1,2\n", {}, "Did you mean V"),
        ("t,v,v\n0,1,5\n1,2,6\n", {}, "column v: expected one column of that name, found 2"),
        ("0.0,1.0\n1.0,2.0\n", {}, "header_line = 0 the columns are named 1, 2"),
        ("t,v\n0,1\n1,2\n", {"delimiter": ";"}, "correct [csv] delimiter (';' is used)"),
        ("t,v\n0,1\n1,2\n", {"clock": Clock()}, "Write [time]"),
        ("t,v\n0,1\n.024,2\n", {"clock": Clock(column="t", period_s=0.025)})
        + ("column t, line 3: expected a row every 25 ms as in [time] period_s, found",),
        ("t(ms),v\n0,1\n1,2\n", {"clock": Clock(column="t", unit="s")})
        + ("column t, line 2: expected a time in s, as the mapping says, found 't(ms)'",),
        ("t,v\nten,1\n", {"clock": Clock(column="t", unit="hh:mm:ss")}, "a time such as 10:00:00"),
        ("t,v,°\n0,1,2\n".encode("latin-1"), {}, "[csv] encoding"),
        ("t,v\n0,1\n", {"encoding": "latin-99"}, "[csv] encoding"),
    ],
)
def test_a_bad_table_is_refused_with_its_place(csv, tmp_path, text, options, message):
    with pytest.raises(DatasetError) as caught:
        csv(text, **options)
    assert str(tmp_path / "a.csv") in str(caught.value)
    assert message in str(caught.value)


def write_npz(path, **columns):
    np.savez(path, **(columns or {"t": 0.01 * np.arange(500.0), "v": np.arange(500.0)[:, None]}))


def write_npy(path):
    np.save(path, np.array([(0.01 * k, k) for k in range(500)], dtype=[("t", "f8"), ("v", "i8")]))


def write_mat(path):
    savemat(path, {"t": 0.01 * np.arange(500), "v": np.arange(500.0), "note": "wet"})


def write_parquet(path, t=None, v=None):
    t = 0.01 * np.arange(500) if t is None else t
    fields = [pa.field("v", pa.float64(), metadata={"unit": "km/h"}), pa.field("o", pa.string())]
    fields.insert(0, pa.field("t", t.type if isinstance(t, pa.Array) else pa.float64()))
    columns = [t, np.arange(500.0) if v is None else v, ["a"] * len(t)]
    parquet.write_table(pa.table(columns, schema=pa.schema(fields)), path)


def write_gz(path):
    rows = "".join(f"{0.01 * k:.2f},{k}\n" for k in range(500))
    path.write_bytes(gzip.compress(f"t,v\n{rows}".encode()))


def write_mf4(path):
    def signals(period_s, *names):
        t = period_s * np.arange(500)
        return [Signal(np.arange(500.0), t, name=n, unit="km/h") for n in names]

    with MDF() as mdf:
        mdf.append(signals(0.01, "v", "Same"))
        mdf.append(signals(0.02, "Steer", "Same"))
        mdf.save(path)


def frames(count=60):
    """MOTION every 10 ms, WHEEL every 20 ms, and frames that no column needs."""
    for k in range(count):
        t_s, motion = 1000.0 + 0.01 * k, (5000 + k).to_bytes(2, "little") + bytes(6)
        yield can.Message(t_s, 256, False, data=motion, channel=1)
        if k % 2 == 0:
            angle = (-k).to_bytes(2, "little", signed=True) + bytes([k, 0])
            yield can.Message(t_s + 0.002, 512, False, data=angle, channel=1)
        yield can.Message(t_s + 0.003, 0x7DF, data=bytes(8), channel=1)


def write_can(path):
    with can.Logger(path) as writer:
        for frame in frames():
            writer(frame)


@pytest.fixture
def settings(tmp_path):
    (tmp_path / "car.dbc").write_text(DBC)
    return CanSettings(dbc=tmp_path / "car.dbc")


WRITERS = {
    "a.npz": write_npz,
    "a.npy": write_npy,
    "a.mat": write_mat,
    "a.parquet": write_parquet,
    "a.csv.gz": write_gz,
    "a.mf4": write_mf4,
}


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_numbers_with_times_and_rows(tmp_path, name):
    WRITERS[name](tmp_path / name)
    log = read(tmp_path / name)
    channel = log.column("v")
    assert log.rows == 500
    np.testing.assert_allclose(channel.t_s, 0.01 * np.arange(500), atol=1e-12)
    assert channel.values.tolist() == list(range(500))
    assert channel.row[:2].tolist() == ([2, 3] if name == "a.csv.gz" else [1, 2])
    assert channel.unit == ("km/h" if name in ("a.parquet", "a.mf4") else "")


@pytest.mark.parametrize("share", [0.0, 0.5, 0.95])
@pytest.mark.parametrize("name", [*WRITERS, "a.blf", "a.asc", "a.log", "a.trc"])
def test_a_truncated_file_is_refused(tmp_path, settings, name, share):
    path = tmp_path / name
    WRITERS.get(name, write_can)(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))].rstrip(b"\r\n"))
    with pytest.raises(DatasetError, match=r"a\.\w+"):
        read(path, *([] if name in WRITERS else ["Speed"]), can=settings)


def test_fields_of_matlab_structs_and_columns_of_arrays_have_names(tmp_path):
    run = {"vx": np.arange(4.0), "imu": {"r": {"Data": np.ones(4)}}}
    savemat(tmp_path / "a.mat", {"t": np.arange(4) * 0.02, "run": run})
    log = read(tmp_path / "a.mat", "run.vx", "run.imu.r.Data")
    assert [each.values[2] for each in log.columns] == [2.0, 1.0]
    with (tmp_path / "speed").open("wb") as file:
        np.save(file, np.stack([0.1 * np.arange(4), np.arange(4.0)], axis=1))
    assert read(tmp_path / "speed", "2", clock=Clock(column="1")).columns[0].values[3] == 3.0


@pytest.mark.parametrize("unit", ["iso8601", "ns"])
def test_stamps_since_1970_keep_their_nanoseconds(tmp_path, unit):
    stamps = pa.array([1_692_117_187_463_808_000 + k * 25_000_123 for k in range(3)])
    stamps = stamps.cast(pa.timestamp("ns")) if unit == "iso8601" else stamps
    write_parquet(tmp_path / "a.parquet", stamps, [1.0, None, 3.0])
    channel = read(tmp_path / "a.parquet", clock=Clock(column="t", unit=unit)).column("v")
    assert channel.t_s == pytest.approx([0.0, 0.025000123, 0.050000246], abs=1e-12)
    np.testing.assert_equal(channel.values, [1.0, np.nan, 3.0])


def write_new_mat(path):
    head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    path.write_bytes(head.ljust(512) + b"\x89HDF\r\n\x1a\n")


def npz(**columns):
    return lambda path: write_npz(path, **columns)


OBJECTS = np.array([{}], dtype=object)


@pytest.mark.parametrize(
    ("name", "write", "column", "message"),
    [
        ("a.npz", npz(v=np.zeros(5), r=np.zeros(6)), "r", "v of 5, r of 6"),
        ("a.npz", npz(v=np.zeros((5, 2)), r=np.zeros(5)), "r", "column v: expected a vector"),
        ("a.npz", npz(v=np.array(["a", "b"]), r=np.zeros(2)), "r", "column v: expected a vector"),
        ("a.npz", npz(v=np.zeros(5)), "r", "expected a column 'r'"),
        ("a.npy", lambda path: np.save(path, np.zeros((2, 3, 4))), "1", r"shape \(2, 3, 4\)"),
        ("a.npy", lambda path: np.save(path, OBJECTS, allow_pickle=True), "1", "foreign"),
        ("a.parquet", write_parquet, "o", "column o: expected numbers, found string"),
        ("a.mat", write_new_mat, "v", "-v7"),
    ],
)
def test_files_without_columns_of_numbers_are_refused(tmp_path, name, write, column, message):
    write(tmp_path / name)
    with pytest.raises(DatasetError, match=message):
        read(tmp_path / name, "v", column, clock=EVERY_10_MS)


def test_mdf_channels_have_the_time_of_their_group(tmp_path):
    path = tmp_path / "a.mf4"
    write_mf4(path)
    log = read(path, "v", "Steer", "Same@1")
    assert [column.t_s[1] for column in log.columns] == pytest.approx([0.01, 0.02, 0.02])
    with pytest.raises(DatasetError, match="Same@0, Same@1"):
        read(path, "Same")
    with pytest.raises(DatasetError, match="Did you mean Steer"):
        read(path, "Steering")


RAWS = np.array([5400, 5410, 0, 65535, 5420, 65534, 1], dtype=np.uint16)
LINEAR = {"a": 0.01, "b": 0.0}
LABELS = {"val_0": 0, "text_0": b"Standstill", "val_1": 65535, "text_1": b"SNA"}
AT_THE_END = {"lower_1": 65534, "upper_1": 65535, "text_1": b"Sensor_Error"}
RANGES = {"lower_0": 0, "upper_0": 0, "text_0": b"no error", **AT_THE_END}
SCALED = {"lower_0": 0, "upper_0": 65533, "text_0": LINEAR, **AT_THE_END}


@pytest.mark.parametrize(
    ("conversion", "scale", "missing"),
    [
        ({**LABELS, "default_addr": LINEAR}, 0.01, (3,)),
        ({**RANGES, "default_addr": LINEAR}, 0.01, (3, 5)),
        (SCALED, 0.01, (3, 5)),
        (LABELS, 1.0, (3,)),
        ({"val_0": 0, "text_0": b"Off", "val_1": 1, "text_1": b"On"}, 1.0, ()),
        ({**LABELS, "default_addr": b"valid"}, 1.0, (3,)),
        ({"val_0": 1, "text_0": b"Off", "val_1": 0, "text_1": b"On", "default_addr": b"init"},
         1.0, (0, 1, 3, 4, 5)),
        ({"val_0": 1, "text_0": b"Init", "val_1": 5400, "text_1": b"Cruise"}, 1.0, (6,)),
    ],
)  # fmt: skip
def test_labels_of_mdf_are_numbers_or_gaps(tmp_path, conversion, scale, missing):
    t_s, kept = 0.01 * np.arange(len(RAWS)), np.delete(np.arange(len(RAWS)), missing)
    # MDF 3 has no conversion beside texts.
    for version in ("4.10", "3.30")[: 2 if scale == 1.0 else 1]:
        path = tmp_path / ("a.mf4" if version == "4.10" else "a.mdf")
        with MDF(version=version) as mdf:
            mdf.append([Signal(RAWS, t_s, name="v", unit="km/h", conversion=conversion)])
            mdf.save(path)
        (channel,) = read(path, "v").columns
        assert channel.values == pytest.approx(scale * RAWS[kept])
        assert channel.t_s == pytest.approx(t_s[kept])
        assert channel.row.tolist() == (kept + 1).tolist()
        assert (channel.unit, bool(channel.unusable)) == ("km/h", bool(missing))


def test_an_mdf_channel_without_any_measurement_is_refused(tmp_path):
    labels = {"val_0": 7, "text_0": b"SNA", "default_addr": LINEAR}
    with MDF() as mdf:
        raws = np.full(9, 7, np.uint8)
        mdf.append([Signal(raws, 0.1 * np.arange(9), name="v", conversion=labels)])
        mdf.save(tmp_path / "a.mf4")
    with pytest.raises(DatasetError, match="found none among 9 samples: 9 'SNA' in the file"):
        read(tmp_path / "a.mf4", "v")


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log"])
def test_can_signals_have_the_time_stamps_of_their_frames(tmp_path, settings, suffix):
    write_can(tmp_path / f"a{suffix}")
    log = read(tmp_path / f"a{suffix}", "Speed", "WHEEL.Angle", can=settings)
    speed, angle = log.columns
    np.testing.assert_allclose(speed.values, 50.0 + 0.01 * np.arange(60))
    np.testing.assert_allclose(np.diff(speed.t_s), 0.01, atol=2e-4)
    np.testing.assert_allclose(angle.values, -0.1 * np.arange(0, 60, 2))
    assert (speed.unit, angle.unit) == ("km/h", "deg")
    assert angle.t_s[0] - speed.t_s[0] == pytest.approx(0.002, abs=2e-4)


def test_positions_are_degrees_if_the_dbc_says_so(tmp_path, settings):
    write_can(tmp_path / "a.log")
    (tmp_path / "map.toml").write_text(
        f'can = {{ dbc = "{settings.dbc}" }}\n[states]\nvx_mps = {{ column = "Speed" }}\n'
        '[inputs]\nrate_radps = { column = "YawRate" }\n[pose]\nyaw = { column = "YawRate", '
        'unit = "deg", factor = 1.0001 }\nx = { column = "Angle" }\ny = { column = "Angle" }\n'
    )
    mapping, _ = read_mapping(tmp_path / "map.toml")
    (found,) = find_logs([tmp_path / "a.log"], mapping)
    drive = to_drive(read_log(found, mapping), mapping)
    assert [signal.unit for signal in drive.poses] == ["m", "m", "rad"]
    assert drive.poses[1].values[1] == pytest.approx(-0.2 * 110_574.0, rel=1e-3)


@pytest.mark.parametrize(
    ("column", "change", "message"),
    [
        ("Counter", {}, r"WHEEL\.Counter, OTHER\.Counter"),
        ("yawrate", {}, r"'yawrate'.*Did you mean YawRate"),
        ("OTHER.Counter", {}, r"column OTHER\.Counter: .* no frame of OTHER"),
        ("Speed", {"channel": 7}, r"on channel 7, found none; other channels have them: 2 \(60\)"),
        ("Speed", None, r"\[can\] dbc"),
    ],
)
def test_can_signals_that_are_not_in_the_log_are_refused(
    tmp_path, settings, column, change, message
):
    write_can(tmp_path / "a.blf")
    used = None if change is None else settings.model_copy(update=change)
    with pytest.raises((DatasetError, ConfigError), match=message):
        read(tmp_path / "a.blf", column, can=used)


def frame_log(end):
    return lambda path: path.write_text(f"(1.000000) can0 100#8813E20000000000\n{end}")


def asc_without_its_end(path):
    write_can(path)
    path.write_bytes(path.read_bytes().replace(b"End TriggerBlock\n", b""))


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("a.log", frame_log("(1.010000) can0 100#88\n"), "1 frames of MOTION"),
        ("a.log", frame_log("(1.0100"), "truncated"),
        ("a.log", frame_log("(1.010000) can0 100#88zz\n"), r"a\.log, line 2"),
        ("a.asc", asc_without_its_end, "End TriggerBlock"),
    ],
)
def test_a_damaged_can_log_is_refused_with_its_place(tmp_path, settings, name, write, message):
    write(tmp_path / name)
    with pytest.raises(DatasetError, match=message):
        read(tmp_path / name, "Speed", can=settings)


def damaged_drive(path, seed):
    """A log of the example's car, with everything that makes a sample none."""
    rng, writer = np.random.default_rng(seed), state_writer(example())
    with can.Logger(path) as log:
        for tick in range(160):
            for frame in writer.frames(VALUES, tick):
                frame.timestamp = 0.025 * tick + 1e-5 * (frame.arbitration_id % 7)
                damage = rng.integers(12)
                if damage == 0:
                    frame.data[: len(frame.data) // 2] = bytes(
                        rng.integers(256, size=len(frame.data) // 2).tolist()
                    )
                elif damage == 1 and tick > 100:
                    frame.data, frame.dlc = frame.data[:-1], frame.dlc - 1
                if damage != 2:
                    log(frame)


@pytest.mark.parametrize("suffix", [".log", ".blf"])
@pytest.mark.parametrize("seed", range(2))
def test_import_and_signals_check_use_the_same_samples(tmp_path, suffix, seed):
    damaged_drive(path := tmp_path / f"a{suffix}", seed)
    for name in ("car.dbc", "line.csv"):
        (tmp_path / name).write_text((EXAMPLE.parent / name).read_text())
    text = EXAMPLE.read_text().replace('engage = { column = "AutopilotSwitch" }', "engage = true")
    (tmp_path / "car.toml").write_text(text)  # the check judges the whole log
    mapping, _ = read_mapping(tmp_path / "car.toml")
    report = check_signals(read_car(tmp_path / "car.toml"), read_frames(path, ""), str(path))
    checked = {each.column: each for each in report.slots}
    for slot in mapping.slots:
        found = checked[slot.column.column]
        request = Request(path, [slot.column.names], STAMPED, can=mapping.can, slots=[slot])
        request = request._replace(messages=mapping.messages)
        if found.problem and "gap" not in found.problem:
            with suppress(DatasetError):  # too many of the samples are none
                assert len(read_file(request).columns[0].values) == found.samples - found.unusable
        else:
            (series,) = read_file(request).columns
            assert len(series.values) == found.samples - found.unusable
