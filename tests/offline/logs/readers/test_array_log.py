"""Named arrays of npz archives and MATLAB files are columns of a log."""

import numpy as np
import pytest
from scipy.io import savemat

from offline.logs.mapping import TimeMapping
from offline.logs.readers.array_log import read_mat, read_npy, read_npz
from rt_controller.contract.errors import DatasetError

EVERY_10_MS = TimeMapping(period_s=0.01)


def test_rows_without_time_are_one_period_apart(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, ux=np.arange(5.0), r=np.arange(5)[:, None])
    log = read_npz(
        path,
        (
            ("r",),
            ("ux",),
        ),
        EVERY_10_MS,
    )
    assert log.rows == 5
    assert log.channel("r").values.tolist() == [0, 1, 2, 3, 4]
    assert log.channel("ux").t_s[-1] == pytest.approx(0.04)
    assert log.channel("ux").row.tolist() == [1, 2, 3, 4, 5]


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_truncated_archive_is_refused(tmp_path, share):
    path = tmp_path / "a.npz"
    np.savez(path, ux=np.arange(500.0))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(DatasetError, match=r"a\.npz.*truncated"):
        read_npz(path, (("ux",),), EVERY_10_MS)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"ux": np.zeros(5), "r": np.zeros(6)}, "arrays of one length, found ux of 5, r of 6"),
        ({"ux": np.zeros((5, 2)), "r": np.zeros(5)}, "column ux: expected a vector of numbers"),
        ({"ux": np.array(["a", "b"]), "r": np.zeros(2)}, "column ux: expected a vector"),
        ({"ux": np.zeros(5)}, "expected a column 'r'"),
    ],
)
def test_arrays_that_are_not_columns_of_numbers_are_refused(tmp_path, arrays, message):
    path = tmp_path / "a.npz"
    np.savez(path, **arrays)
    with pytest.raises(DatasetError) as caught:
        read_npz(
            path,
            (
                ("ux",),
                ("r",),
            ),
            EVERY_10_MS,
        )
    assert message in str(caught.value)


def test_matlab_variables_and_fields_of_structs_are_columns(tmp_path):
    path = tmp_path / "a.mat"
    run = {"vx": np.arange(4.0), "note": "wet", "imu": {"r": {"Data": np.ones(4)}}}
    savemat(path, {"t": np.arange(4) * 0.02, "run": run})
    log = read_mat(path, (("run.vx",),), TimeMapping(column="t", period_s=0.02))
    assert log.channel("run.vx").values.tolist() == [0, 1, 2, 3]
    log = read_mat(path, (("run.imu.r.Data",),), TimeMapping(column="t"))
    assert log.channel("run.imu.r.Data").values.tolist() == [1, 1, 1, 1]


def test_a_truncated_matlab_file_is_refused(tmp_path):
    path = tmp_path / "a.mat"
    savemat(path, {"ux": np.arange(1000.0)})
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(DatasetError, match="truncated"):
        read_mat(path, (("ux",),), EVERY_10_MS)


def test_columns_of_an_array_have_numbers_or_the_names_of_its_fields(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.stack([0.1 * np.arange(4), np.arange(4.0)], axis=1))
    log = read_npy(path, (("2",),), TimeMapping(column="1"))
    assert log.channel("2").t_s[-1] == pytest.approx(0.3)
    np.save(path, np.array([(0, 5.0), (1, 6.0)], dtype=[("t", "i8"), ("v", "f8")]))
    assert read_npy(path, (("v",),), TimeMapping(column="t")).channel("v").values[1] == 6.0


def test_arrays_that_are_damaged_or_have_other_shapes_are_refused(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.zeros((2, 3, 4)))
    with pytest.raises(DatasetError, match=r"shape \(2, 3, 4\)"):
        read_npy(path, (("1",),), EVERY_10_MS)
    np.save(path, np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(DatasetError, match="truncated, damaged or foreign"):
        read_npy(path, (("1",),), EVERY_10_MS)
    np.save(path, np.zeros(500))
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(DatasetError, match="truncated, damaged or foreign"):
        read_npy(path, (("1",),), EVERY_10_MS)


def test_version_7_3_of_matlab_is_refused_with_the_remedy(tmp_path):
    path = tmp_path / "a.mat"
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n")
    with pytest.raises(DatasetError, match="-v7"):
        read_mat(path, (("ux",),), EVERY_10_MS)
