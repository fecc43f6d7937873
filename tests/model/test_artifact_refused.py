"""A bundle whose fields do not fit is refused with expected, found, remedy."""

import os
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rt_controller.contract.car import Car
from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.limits import SteeringGeometry
from rt_controller.model.artifact import LARGEST_FILE_BYTES, load_bundle, save_bundle
from rt_controller.model.bundle import Bundle, PlanSample
from rt_controller.model.lift import LiftSample


def rewrite(folder: Path, **changes: object) -> None:
    """The npz with some fields replaced (or, given None, removed)."""
    path = folder / "koopman.npz"
    with np.load(path) as archive:
        fields = {key: archive[key] for key in archive.files}
    fields.update(changes)
    np.savez(path, **{key: value for key, value in fields.items() if value is not None})


CAR = SteeringGeometry(wheelbase_m=3.2, rear_axle_m=1.5, steering_ratio=16.0)


def test_an_altered_or_missing_geometry_is_refused(bundle, tmp_path):
    save_bundle(tmp_path, replace(bundle, car=Car(*CAR)), "card")
    rewrite(tmp_path, wheelbase_m=np.float64(3.3))
    with pytest.raises(ArtifactError, match="SHA-256"):
        load_bundle(tmp_path)
    for missing in (("wheelbase_m",), ("rear_axle_m", "steering_ratio")):
        rewrite(tmp_path, **dict.fromkeys(missing))
        with pytest.raises(ArtifactError, match="wheelbase_m"):
            load_bundle(tmp_path)


def test_a_geometry_of_no_road_vehicle_is_refused(bundle, tmp_path):
    other = replace(bundle, car=Car(*CAR._replace(wheelbase_m=2910.0, steering_ratio=0.05)))
    with pytest.raises(ArtifactError, match=r"wheelbase_m: .* 2910.0; steering_ratio: .* 0.05"):
        save_bundle(tmp_path, other, "card")


def with_plans(bundle: Bundle) -> Bundle:
    """The same with stored plans."""
    rng = np.random.default_rng(2)
    return replace(
        bundle,
        plans=PlanSample(
            state=rng.normal(size=(2, 6)),
            curvature_per_m=rng.normal(size=2),
            path=rng.normal(size=(2, 6)),
            previous=rng.normal(size=(2, 3)),
            inputs=rng.normal(size=(2, 4, 3)),
        ),
    )


HISTORY = ("vx_mps", "vy_mps", "yaw_rate_radps", "throttle", "brake_n", "steer_rad")


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("format_version", np.int64(1), "format_version = 5, found 1."),
        ("format_version", np.str_("one"), "format_version = 5, found one."),
        ("format_version", np.array([2]), "format_version"),
        ("format_version", None, "'format_version'"),
        # Other signals are another model: the numbers may fit, the hash does not.
        ("state_fields", np.array([*"abcdef"]), "history_fields out of"),
        ("state_units", np.array(["km/h", "m/s", "rad/s", "m", "m", "rad"]), "SHA-256"),
        ("dt_s", np.float64(0.024), "SHA-256"),
        ("state_fields", np.array(["vx_mps", "vy_mps"]), "state_units"),
        ("state_fields", np.array(["vx_mps"] * 6), "different names for all signals"),
        ("input_fields", np.array(["throttle", "brake_n", "ey_m"]), "different names for all"),
        ("state_fields", np.str_("vx_mps"), "in state_fields"),
        ("input_fields", np.arange(3.0), "in input_fields"),
        ("exogenous_units", None, "'exogenous_units'"),
        ("dt_s", np.float64(0.0), "positive dt_s"),
        ("dt_s", np.str_("fast"), "0 dimensions in dt_s"),
        ("dt_s", np.float64(np.nan), "finite numbers in dt_s"),
        ("lift_inputs", np.array(["x"]), "expected lift_inputs = "),
        ("lift_inputs", np.array(["x", "history"]), "SHA-256"),
        ("lift_inputs", np.array(["x", "w", "history", "u"]), "expected lift_inputs = "),
        ("lift_inputs", np.str_("x"), "in lift_inputs"),
        ("history_steps", np.int64(3), "history"),
        ("history_steps", np.int64(-1), "a history with steps and fields, or neither"),
        ("history_steps", np.int64(0), "a history with steps and fields, or neither"),
        ("history_steps", np.float64(4.0), "in history_steps"),
        ("history_steps", np.array([4]), "in history_steps"),
        ("history_fields", np.array(HISTORY[:5]), "shape of selftest_history"),
        ("history_fields", np.array(HISTORY[::-1]), "history_fields out of"),
        ("history_fields", np.array([*HISTORY[:5], "curvature_per_m"]), "history_fields out of"),
        ("history_fields", np.array([*HISTORY[:5], HISTORY[0]]), "history_fields out of"),
        ("A", np.ones((9, 8)), "shape of A"),
        ("A", np.full((9, 9), np.nan), "finite"),
        ("A", np.str_("a matrix"), "2 dimensions in A"),
        ("A", np.float64(1.0), "2 dimensions in A"),
        ("A", np.eye(9, dtype=np.float32), "float64"),
        ("A", np.zeros((0, 0)), "shape of B_uc"),
        ("B_uc", np.zeros((9, 4)), "shape of B_uc"),
        ("B_uw", np.zeros((9, 0)), "shape of B_uw"),
        ("c", None, "'c'"),
        ("c", np.array([{"a": "pickle"}], dtype=object), "pickles"),
        ("plan_path", None, "'plan_path'"),
        ("c", np.ones((9, 1)), "1 dimensions in c"),
        ("gains_N", np.zeros((9, 8)), "shape of gains_N"),
        ("gains_N", np.full((9, 9), np.nan), "finite"),
        ("gains_S", np.zeros((9, 8)), "shape of gains_S"),
        ("gains_S", np.zeros((0, 9)), "shape of gains_S"),
        ("gains_s0", np.zeros(2), "shape of gains_N"),
        ("gains_s0", np.zeros((9, 1)), "1 dimensions in gains_s0"),
        ("gains_factor", np.array([1, 1, 2, 0, 1, 2, 3, 4, 4]), "SHA-256"),
        ("gains_factor", np.array([0, 1]), "shape of gains_factor"),
        ("gains_factor", np.array([0, 1, 2, 0, 1, 2, 5, 4, 4]), "columns 0 to 4 of .u; w; 1."),
        ("gains_factor", np.array([0, 1, 2, 0, 1, 2, 3, 4, 3]), "4 in gains_factor where"),
        ("gains_factor", np.zeros(9), "in gains_factor"),
        ("gains_shape", np.array([0, 0, 1, 1, 1, 1, 1, 2, 2]), "SHA-256"),
        ("gains_shape", np.array([0, 0, 0, 1, 1, 1, 1, 2, 1]), "ascending order in gains_shape"),
        ("gains_shape", np.array([0, 0, 0, 1, 1, 1, 1, 2, 3]), "numbers 0 to 2"),
        ("gains_follows", np.str_("the sun"), "gains_follows = prediction or"),
        ("signal_range", np.zeros((2, 3)), "shape of signal_range"),
        ("signal_range", np.zeros(4), "2 dimensions in signal_range"),
        ("signal_range", np.full((2, 4), np.nan), "finite"),
        ("signal_range", None, "SHA-256"),
        ("movement_S", np.zeros((3, 9)), "'movement_s0'"),
        ("valid_speed_mps", None, "'valid_speed_mps'"),
        ("valid_speed_mps", np.array([3.0, 20.0]), "shape of valid_lateral_mps2"),
        ("valid_speed_mps", np.array([3.0, 20.0, 20.0]), "ascending speeds in valid_speed_mps"),
        ("valid_lateral_mps2", np.array([1.0, -8.0, 9.0]), "no negative value in valid_"),
        ("valid_steer_rad", np.full(3, np.inf), "finite"),
        ("valid_curvature_per_m", np.zeros((3, 1)), "1 dimensions in valid_curvature_per_m"),
        ("valid_conditions", np.zeros((3, 2)), "highest value of 4 quantities"),
        ("valid_conditions", np.tile([1.0, 0.0], (4, 1)), "highest value of 4 quantities"),
        ("valid_conditions", np.zeros((4, 3)), "shape of valid_conditions"),
        ("selftest_x", np.zeros((0, 6)), "shape of selftest"),
        ("selftest_x", np.zeros((5, 7)), "shape of selftest_x"),
        ("selftest_w", np.zeros((5, 2)), "shape of selftest"),
        ("selftest_history", np.zeros((5, 4, 5)), "shape of selftest_history"),
        ("selftest_history", np.zeros((5, 24)), "3 dimensions in selftest_history"),
        ("selftest_psi", np.float64(0.0), "selftest_psi"),
        ("selftest_psi", np.zeros((4, 9)), "shape of selftest"),
        ("name", np.array(["a", "list"]), "in name"),
        ("name", np.str_("mdk\x1b[2J"), "printable characters"),
        ("name", np.str_("m" * 101), "1 to 100 printable characters"),
        ("training", np.float64(1.0), "in training"),
        ("data_sha256", np.zeros(3), "in data_sha256"),
        ("encoder_sha256", np.int64(0), "in encoder_sha256"),
        ("bundle_sha256", np.zeros(64), "in bundle_sha256"),
        ("bundle_sha256", None, "'bundle_sha256'"),
    ],
)
def test_fields_that_do_not_fit_are_refused(bundle, folder, field, value, message):
    save_bundle(folder, with_plans(bundle), "card")
    rewrite(folder, **{field: value})
    with pytest.raises(ArtifactError, match=message) as error:
        load_bundle(folder)
    assert "expected" in str(error.value)
    assert "found" in str(error.value)
    assert "offline-export" in str(error.value)


def test_a_bundle_without_self_test_is_refused(bundle, tmp_path):
    nothing = LiftSample(*(part[:0] for part in bundle.selftest))
    with pytest.raises(ArtifactError, match="self-test instants, found 9 and 0"):
        save_bundle(
            tmp_path, replace(bundle, selftest=nothing, selftest_psi=np.zeros((0, 9))), "card"
        )


def test_fewer_observables_than_states_are_refused(bundle, tmp_path):
    small = replace(
        bundle,
        A=np.eye(5),
        B_uc=bundle.B_uc[:5],
        B_uw=bundle.B_uw[:5],
        c=bundle.c[:5],
        gains=None,
        selftest_psi=bundle.selftest_psi[:, :5],
    )
    with pytest.raises(ArtifactError, match="at least 6 observables"):
        save_bundle(tmp_path, small, "card")


def test_parts_that_do_not_fit_are_not_written(bundle, tmp_path):
    with pytest.raises(ArtifactError, match="shape of B_uc"):
        save_bundle(tmp_path / "model", replace(bundle, B_uc=bundle.B_uc[:, :2]), "card")
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize("name", ["koopman.npz", "encoder.onnx"])
@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (Path.unlink, "No such file.*offline-export"),
        (lambda path: (path.unlink(), path.mkdir()), "nothing readable"),
        (lambda path: (path.unlink(), os.mkfifo(path)), "Not a regular file"),
        (lambda path: os.truncate(path, 2_600_000_000), "2600 MB, where at most 64 MB are read"),
        (lambda path: path.write_bytes(b"PK\x05\x06" + bytes(18)), "expected"),
        (lambda path: path.write_bytes(b"text"), "expected"),
        (lambda path: path.write_bytes(b""), "truncated|SHA-256"),
    ],
)
def test_a_file_that_is_missing_or_none_of_a_bundle_is_refused(folder, name, damage, message):
    """Neither waited for nor read if it is a pipe or has gigabytes."""
    damage(folder / name)
    with pytest.raises(ArtifactError, match=f"(?s){name}.*{message}"):
        load_bundle(folder)


@pytest.mark.parametrize("length", [4, 500])
def test_a_truncated_archive_is_refused(folder, length):
    os.truncate(folder / "koopman.npz", length)
    with pytest.raises(ArtifactError, match="truncated"):
        load_bundle(folder)


def test_an_archive_that_unpacks_to_gigabytes_is_refused_unpacked(folder):
    with (
        zipfile.ZipFile(folder / "koopman.npz", "a", zipfile.ZIP_DEFLATED) as archive,
        archive.open("zeros.npy", "w") as member,
    ):
        for _ in range(30):
            member.write(bytes(10_000_000))
    assert (folder / "koopman.npz").stat().st_size < LARGEST_FILE_BYTES
    with pytest.raises(ArtifactError, match="where at most 256 MB are read"):
        load_bundle(folder)
