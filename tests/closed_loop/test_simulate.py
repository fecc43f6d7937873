"""`simulate`: the same drive as the program, as a table with units."""

import csv
import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from kinematic_plant import KinematicCar
from PIL import Image

from rt_controller import cli, simulate
from rt_controller.contract.errors import ConfigError, MissingExtraError, PlantError
from rt_controller.contract.signals import Mode
from rt_controller.model.artifact import load_bundle, shipped_model


@pytest.fixture(scope="module")
def lti():
    return load_bundle(shipped_model("lti"))


@pytest.fixture(scope="module")
def drive(lti):
    return simulate("straight", model=lti, plant=KinematicCar(), duration_s=2.0)


def test_a_plant_of_any_class_can_be_driven(drive):
    nominal = np.array(drive.modes) == Mode.NOMINAL
    assert nominal.sum() >= 60
    assert np.abs(drive["ey_m"][nominal]).max() < 0.05


def test_columns_have_names_and_units(drive):
    assert drive.values.shape == (len(drive), len(drive.columns))
    assert drive.units["steer_rad"] == "rad"
    assert tuple(drive) == drive.columns
    assert "lateral error RMS" in repr(drive)
    np.testing.assert_allclose(np.diff(drive["time_s"]), 0.025, atol=1e-9)
    with pytest.raises(KeyError, match="expected one of time_s"):
        drive["speed"]


def test_a_drive_says_why_and_in_which_tick_its_safe_stop_began(drive):
    assert drive.stop_cause == "STOP_REQUESTED"
    assert drive.stop_tick == drive.modes.index(Mode.SAFE_STOP)
    assert drive.stop_s == pytest.approx(drive["time_s"][drive.stop_tick])


@pytest.mark.parametrize(
    ("name", "wrong", "error", "words"),
    [
        *(("duration_s", value, ConfigError, "duration_s") for value in (0.0, np.nan, np.inf)),
        ("duration_s", "long", TypeError, "^duration_s: expected .*, found 'long'"),
        ("scenario", None, TypeError, "^scenario: expected .*, found None"),
        ("car", 3, TypeError, "^car: expected .*, found 3"),
        ("friction", "wet", TypeError, "^friction: expected .*, found 'wet'"),
    ],
)
def test_an_argument_that_cannot_be_used_is_refused_by_its_name(lti, name, wrong, error, words):
    with pytest.raises(error, match=words):
        simulate(**{"scenario": "straight", "model": lti, name: wrong})


@pytest.mark.parametrize("write", ["plot", "to_csv"])
def test_a_file_that_is_no_path_is_refused_by_name(drive, write):
    with pytest.raises(TypeError, match="file: expected the path of a file, found 3"):
        getattr(drive, write)(3)


def test_a_drive_is_written_as_csv(drive, tmp_path):
    drive.to_csv(tmp_path / "drive.csv")
    with (tmp_path / "drive.csv").open(encoding="utf-8") as file:
        rows = list(csv.reader(file))
    assert tuple(rows[0]) == drive.columns
    assert len(rows) == 1 + len(drive)
    with pytest.raises(ConfigError, match="expected a file that can be written"):
        drive.to_csv(tmp_path / "missing" / "drive.csv")


def test_a_drive_becomes_a_data_frame_with_units(drive, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setitem(sys.modules, "pandas", None)
        with pytest.raises(MissingExtraError, match=r"\[logs\]"):
            drive.to_pandas()
    pytest.importorskip("pandas")
    frame = drive.to_pandas()
    assert list(frame.columns) == list(drive.columns)
    assert frame.attrs["units"]["ey_m"] == "m"


def test_refused_choices_are_named_all_at_once_as_arguments():
    with pytest.raises(ConfigError) as refused:
        simulate("strait", model="lti", car="lorry", friction=7.0)
    starts = [line.split(":")[0] for line in str(refused.value).splitlines()]
    assert starts == ["scenario", "car", "friction"]


def test_a_drive_is_drawn(drive, tmp_path):
    pytest.importorskip("matplotlib")
    figure = drive.plot(tmp_path / "drive.svg")
    assert (tmp_path / "drive.svg").read_text().count("steering wheel / deg") >= 1
    above, *over_time = figure.axes
    assert (above.get_xlabel(), above.get_ylabel()) == ("x / m", "y / m")
    assert len(over_time) == 6
    assert figure.get_suptitle().startswith("straight, lti")
    assert figure._repr_png_().startswith(b"\x89PNG")  # what a notebook shows
    with pytest.raises(ConfigError, match=r"\.png, \.svg, \.pdf"):
        drive.plot(tmp_path / "drive.xyz")


def test_a_moving_picture_has_a_frame_each_tenth_of_a_second(tmp_path):
    short = simulate("double_lane_change", model="lti", duration_s=0.5)
    short.plot(tmp_path / "drive.gif")
    with Image.open(tmp_path / "drive.gif") as picture:
        found = picture.format, picture.info["duration"], picture.n_frames
    assert found == ("GIF", 100, -(-len(short) // 4))


def test_drives_are_laid_over_each_other_by_name(drive):
    pytest.importorskip("matplotlib")
    from rt_controller.report.overlay import overlay

    far_off = replace(drive, true_poses=drive.true_poses + [0.0, 10.0, 0.0])
    figure = overlay({"first": drive, "second": drive, "bad": far_off})
    names = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    order = ["first", "second", "bad"]
    assert [name for name in names if name in order] == order
    error = figure.axes[1]
    assert [len(axes.lines) for axes in figure.axes[1:]] == [3, 3, 3]
    assert error.get_ylim()[1] < 0.1
    assert "cut off: bad, whose peak is 10" in error.get_title("left")


def test_a_plant_that_fails_is_an_error(lti):
    with pytest.raises(PlantError, match="the test"):
        simulate("straight", model=lti, plant=KinematicCar(fails_after_s=1.0))


class RaisingCar(KinematicCar):
    """A plant that raises from this call on."""

    is_closed = False

    def __init__(self, first_bad_call):
        super().__init__()
        self.good_calls = first_bad_call - 1

    def count(self):
        self.good_calls -= 1
        if self.good_calls < 0:
            raise ZeroDivisionError("no tyre")

    def reset(self, v0_mps):
        self.count()
        return super().reset(v0_mps)

    def step(self, control, dt_s):
        self.count()
        return super().step(control, dt_s)

    def close(self):
        self.is_closed = True


@pytest.mark.parametrize(
    ("first_bad_call", "named"), [(1, "the reset to 16.67 m/s"), (5, r"step \d+ after")]
)
def test_a_plant_that_raises_is_closed_and_named_with_the_call(lti, first_bad_call, named):
    plant = RaisingCar(first_bad_call)
    expected = rf"plant kinematic: .* {named}.* ZeroDivisionError: no tyre"
    with pytest.raises(PlantError, match=expected) as raised:
        simulate("straight", model=lti, plant=plant)
    assert isinstance(raised.value.__cause__, ZeroDivisionError)
    assert plant.is_closed


class WithoutClose:
    """A plant that lacks two names."""

    name, failure = "incomplete", None

    def reset(self, v0_mps):
        return np.array([v0_mps, 0.0, 0.0])

    def step(self, control, dt_s):
        return np.zeros((1, 3))


class FlatMotion(KinematicCar):
    """A plant whose motion has one dimension only."""

    def step(self, control, dt_s):
        return np.zeros(3)


@pytest.mark.parametrize(
    ("plant", "message"),
    [
        (WithoutClose(), "found no outputs, close"),
        (KinematicCar, "found a class"),
        (FlatMotion(), r"plant\.step: expected an array \(n, 3\) .* found the shape \(3,\)"),
    ],
)
def test_a_plant_with_a_mistake_is_refused_before_the_drive(lti, plant, message):
    with pytest.raises(ConfigError, match=message):
        simulate("straight", model=lti, plant=plant)


def test_the_program_writes_the_same_figures(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    options = "--bus virtual --pace lockstep --quiet --scenario lane_change_60 --model lti"
    files = ("--json", str(tmp_path / "drive.json"), "--plot", str(tmp_path / "drive.png"))
    monkeypatch.setattr("sys.argv", ["rt-controller", *options.split(), *files])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 0
    figures = json.loads((tmp_path / "drive.json").read_text())
    assert not figures["memory_locked"]  # simulated time does not need it
    driven = figures["driven"]
    assert (driven["scenario_file"], driven["plant"], driven["pace"], driven["friction"]) == (
        "lane_change_60", "own", "lockstep", 0.85
    )  # fmt: skip
    assert driven["car"] == "c_class_150kw_awd"
    assert figures["ey_rms_m"] == simulate("lane_change_60", model="lti").errors.ey_rms_m
    assert (tmp_path / "drive.png").stat().st_size > 10_000
