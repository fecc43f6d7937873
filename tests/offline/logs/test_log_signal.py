"""A column becomes a signal in SI, checked, cut at gaps and resampled to one period."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_logs import MAPPING, signal_of
from made_logs import log_of as made_log

from offline.logs.readers.log import Log, LogColumn
from offline.logs.signal import (
    LoggedDrive,
    LogSignal,
    Stretch,
    find_stretches,
    grid,
    resample,
    to_drive,
)
from rt_controller.contract.errors import DatasetError
from rt_controller.mapping.tables import Sampling

ONE_OF_EACH = """
[states]
vx_mps = {{ column = "v"{state} }}
[inputs]
steer_rad = {{ column = "d", unit = "rad" }}
"""


def log_of(values, unit=None, dt_s=0.1):
    values = np.asarray(values, dtype=float)
    t_s = dt_s * np.arange(len(values))
    rows, of = np.arange(2, len(values) + 2), (Path("a.csv"), "line")
    columns = (
        LogColumn("v", t_s, values, rows, unit, *of),
        LogColumn("d", t_s, np.linspace(0, 0.1, len(values)), rows, None, *of),
    )
    return Log("a.csv", columns, len(values))


def series(parse, values, state="", unit="m/s", extra=""):
    mapping = parse(ONE_OF_EACH.format(state=state) + extra)
    return signal_of(to_drive(log_of(values, unit), mapping), "vx_mps")


def test_factor_offset_unit_and_sign_apply_in_this_order_and_the_delay_is_subtracted(parse):
    state = ', unit = "km/h", factor = 2.0, offset = -1.0, sign = -1, delay_s = 0.32'
    found = series(parse, [10.0, 19.0], state, unit=None)
    assert found.values == pytest.approx([-(2 * 10 - 1) / 3.6, -(2 * 19 - 1) / 3.6])
    assert found.t_s == pytest.approx([-0.32, -0.22])


@pytest.mark.parametrize(
    ("values", "state", "unit", "message"),
    [
        ([1.0, np.nan, 3.0], "", "m/s", r"a\.csv, column v, line 3: expected a number"),
        ([1.0, 2.0, np.inf], "", "m/s", r"column v, line 4: expected a number, found an inf"),
        ([1.0, 2.0], ', unit = "m/s"', "kph", r"column v: expected numbers in m/s.*in kph"),
        ([1.0, 2.0], "", None, r"column v: expected a unit, found no unit"),
        ([1.0, 2.0], "", "blah", "found 'blah'"),
        ([1.0, 2.0], "", "deg/s", "converted to m/s as in the name vx_mps"),
        ([90.0, 100.0, 180.0], "", "m/s", r"v, line 4: .*between -20 and 120 m/s.*180"),
        ([1.0], "", "m/s", "at least two samples"),
    ],
)
def test_numbers_and_units_that_cannot_be_are_refused_with_their_place(
    parse, values, state, unit, message
):
    with pytest.raises(DatasetError, match=message):
        series(parse, values, state, unit=unit)


@pytest.mark.parametrize(
    ("values", "state", "unit", "found"),
    [
        ([1.0, np.nan, 3.0], ', missing = "skip"', "m/s", [1.0, 3.0]),
        ([1.0, 2.0], ', unit = "m/s"', "blah", [1.0, 2.0]),
        ([3.6, 7.2], ', unit = "kph"', "km/h", [1.0, 2.0]),
        ([3.6, 7.2], "", "km/h", [1.0, 2.0]),
        ([90.0, 180.0], ", plausible = [0.0, 200.0]", "m/s", [90.0, 180.0]),
    ],
)
def test_the_mapping_can_allow_them(parse, values, state, unit, found):
    assert series(parse, values, state, unit=unit).values == pytest.approx(found)


@pytest.mark.parametrize(
    ("values", "state", "connected", "jumps"),
    [
        ([10.0, 10.1, 40.0, 40.1], "", [True, False, True], 1),
        ([1.0, 3.5, 4.0, 4.5, 2.0], ", keep = [3.0, 60.0]", [False, True, True, False], 0),
    ],
)
def test_the_drive_is_cut_where_a_signal_jumps_or_leaves_its_keep_interval(
    parse, values, state, connected, jumps
):
    found = series(parse, values, state)
    assert found.connected.tolist() == connected
    assert found.jumps == jumps


def test_noise_of_fast_samples_is_not_a_jump(parse):
    mapping = parse(ONE_OF_EACH.format(state=', unit = "m/s"'))
    noisy = 10.0 + 0.3 * np.random.default_rng(0).choice([-1.0, 1.0], 1000)
    found = signal_of(to_drive(log_of(noisy, dt_s=0.001), mapping), "vx_mps")
    assert found.jumps == 0


def test_the_first_seconds_can_be_skipped(parse):
    found = series(parse, [1.0, 2.0, 3.0, 4.0], extra="[time]\nskip_first_s = 0.15\n")
    assert found.values.tolist() == [3.0, 4.0]
    assert found.row.tolist() == [4, 5]


@pytest.mark.parametrize(("setting", "is_connected"), [("", False), ("longest_gap_s = 0.6", True)])
def test_two_lost_samples_are_bridged_and_three_are_a_gap(parse, setting, is_connected):
    mapping = parse(ONE_OF_EACH.format(state=', unit = "m/s"') + f"[time]\n{setting}\n")
    log = log_of(np.arange(12.0))
    whole = log.columns[0]
    lost = [np.delete(each, [2, 3, 6, 7, 8]) for each in (whole.t_s, whole.values, whole.row)]
    shorter = replace(whole, t_s=lost[0], values=lost[1], row=lost[2])
    drive = to_drive(replace(log, columns=(shorter, log.columns[1])), mapping)
    found = signal_of(drive, "vx_mps")
    assert found.connected.tolist() == [True, True, True, is_connected, True, True]


def test_yaw_is_continuous_over_full_turns(parse):
    pose = "".join(f'{name} = {{ column = "{name}", unit = "m" }}\n' for name in "xy")
    mapping = parse(MAPPING + "[pose]\n" + pose + 'yaw = { column = "yaw", unit = "deg" }\n')
    t_s = 0.1 * np.arange(100)
    names = [column.column for column in mapping.every_column]
    columns = dict.fromkeys(names, 0.01 * t_s) | {"yaw": (40 * t_s + 180) % 360 - 180}
    drive = to_drive(made_log(t_s, columns), mapping)
    assert signal_of(drive, "yaw").values == pytest.approx(np.radians(40 * t_s))


PERIOD_S = 0.025


def sampled(t_s, values, sampling=Sampling.SAMPLED, longest_s=0.1):
    t_s, values = np.asarray(t_s, dtype=float), np.asarray(values, dtype=float)
    connected = np.diff(t_s) <= longest_s
    rows = np.arange(len(t_s))
    column = LogColumn("v", t_s, values, rows, "m/s", Path("a.csv"))
    return LogSignal("v", "m/s", t_s, values, rows, column, sampling, connected)


def whole(one):
    return Stretch(float(one.t_s[0]), float(one.t_s[-1]))


def test_stretches_are_where_all_signals_are_known():
    fast = sampled([0.0, 0.05, 0.1, 0.5, 0.55, 0.6], range(6))
    late = sampled([0.02, 0.08, 0.14, 0.2, 0.28, 0.36, 0.44, 0.52, 0.58], range(9))
    drive = LoggedDrive("a.csv", 6, (fast, late))
    assert find_stretches(drive) == [Stretch(0.02, 0.1), Stretch(0.5, 0.58)]


RAMP = 0.01 * np.arange(101)
NOISE = np.random.default_rng(0).normal(size=50)


@pytest.mark.parametrize(
    ("sampling", "t_s", "values", "expected"),
    [
        (Sampling.SAMPLED, 3.0 + PERIOD_S * np.arange(50), NOISE, NOISE),
        (Sampling.SAMPLED, [0.0, 0.04, 0.08], [0.0, 4.0, 0.0], [0.0, 2.5, 3.0, 0.5]),
        # Averaging does not shift a ramp at its ends.
        (Sampling.SAMPLED, RAMP, 7.0 * RAMP, 7.0 * PERIOD_S * np.arange(41)),
        (Sampling.MEAN, RAMP, RAMP, [*PERIOD_S * (np.arange(40) + 0.5), 1.0]),
        # A held command is weighted by its duration.
        (Sampling.HELD, [0.0, 0.01, 0.04, 0.1], [1.0, 2.0, 4.0, 8.0], [1.6, 2.8, 4.0, 4.0, 8.0]),
    ],
)
def test_a_signal_gets_one_sample_per_period(sampling, t_s, values, expected):
    one = sampled(t_s, values, sampling)
    found = resample(one, whole(one), grid(whole(one), PERIOD_S), PERIOD_S)
    assert found == pytest.approx(np.asarray(expected), abs=1e-9)


def test_fast_samples_are_averaged_so_that_no_frequency_is_aliased():
    """40 Hz sampled every 25 ms would appear as a constant."""
    t = 0.001 * np.arange(2001)
    slow, fast = np.sin(2 * np.pi * 1.0 * t), np.cos(2 * np.pi * 40.0 * t)
    one = sampled(t, slow + fast)
    t_s = grid(whole(one), PERIOD_S)
    found = resample(one, whole(one), t_s, PERIOD_S)
    expected = np.sin(2 * np.pi * t_s)
    assert np.max(np.abs(found - expected)[1:-1]) < 0.01


def test_samples_beyond_a_gap_do_not_influence_a_stretch():
    t = np.concatenate([0.005 * np.arange(41), 1.0 + 0.005 * np.arange(41)])
    one = sampled(t, np.where(t < 0.5, 1.0, 100.0))
    drive = LoggedDrive("a.csv", 82, (one,), ())
    for stretch, value in zip(find_stretches(drive), (1.0, 100.0), strict=True):
        for sampling in Sampling:
            held = replace(one, sampling=sampling)
            found = resample(held, stretch, grid(stretch, PERIOD_S), PERIOD_S)
            assert found == pytest.approx(np.full(len(found), value))
