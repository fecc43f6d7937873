"""The exported FMU: what it declares, what it computes and refuses, and its file."""

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")

import fmpy
from fmpy.simulation import instantiate_fmu
from fmpy.validation import validate_fmu
from golden_drives import wandering_inputs
from made_tyre import TYRE_FILE_TEXT

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.signals import ControlInput
from rt_controller.settings import CarSettings
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.adapters.plants import open_plant
from sim_bridge.car import Car
from sim_bridge.fmu_export.archive import build_fmu
from sim_bridge.fmu_export.description import OUTPUT_FIELDS, STATE_FIELDS
from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.compiler import CompileError, compile_library, find_compiler
from sim_bridge.plant.library import advance, settle
from sim_bridge.plant.parameters import load_parameters, with_road
from sim_bridge.plant.parts import RoadParameters
from sim_bridge.plant.protocol import RoadAt

CAR = "c_class_150kw_awd"
_FOLDER = tempfile.TemporaryDirectory(prefix="exported-fmus-")


@cache
def exported(car: str = CAR) -> Path:
    """The FMU of a car, made once."""
    file = Path(_FOLDER.name) / f"{Path(car).stem}-car.fmu"
    build_fmu(file, car)
    return file


@cache
def car_with_tyre_file() -> str:
    """Path of the default car's file, which names a made tyre file."""
    text = (resources.files("sim_bridge") / "cars" / f"{CAR}.toml").read_text("utf-8")
    entry = 'tyre_file = { value = "made.tir", source = "estimate: a made file" }\n'
    folder = Path(_FOLDER.name)
    (folder / "made.tir").write_text(TYRE_FILE_TEXT, encoding="utf-8")
    (folder / "with_tyre_file.toml").write_text(entry + text, encoding="utf-8")
    return str(folder / "with_tyre_file.toml")


class ExportedFmu:
    """One instance; a failed call raises, with what the FMU logged in `messages`."""

    def __init__(self, file: Path) -> None:
        self.description = fmpy.read_model_description(str(file))
        self._folder = tempfile.TemporaryDirectory(prefix="exported-fmu-")
        fmpy.extract(str(file), unzipdir=self._folder.name)
        self.messages: list[str] = []
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.instance: Any = instantiate_fmu(
            self._folder.name, self.description, "CoSimulation", logger=self._log
        )
        self.step, self.close = self.instance.doStep, self.instance.freeInstance

    def set(self, **values: float) -> None:
        """Set variables; `road__bank_rad` is road.bank_rad."""
        names = [name.replace("__", ".") for name in values]
        self.instance.setReal([self.references[name] for name in names], list(values.values()))

    def get(self, *names: str) -> list[float]:
        """Values of variables."""
        return list(self.instance.getReal([self.references[name] for name in names]))

    def initialise(self, start_s: float = 0.0) -> None:
        """From instantiation to the first step."""
        self.instance.setupExperiment(startTime=start_s)
        self.instance.enterInitializationMode()
        self.instance.exitInitializationMode()

    def _log(self, *arguments: Any) -> None:
        message = arguments[-1]
        self.messages.append(message.decode() if isinstance(message, bytes) else str(message))


def test_every_variable_has_a_unit_and_a_description_and_fmpy_finds_no_problem() -> None:
    assert validate_fmu(str(exported())) == []
    description = ExportedFmu(exported()).description
    units = {unit.name: unit for unit in description.unitDefinitions}
    variables = {variable.name: variable for variable in description.modelVariables}
    assert all(each.description and each.unit in units for each in variables.values())
    expected = {"steer_rad": "rad", "brake_n": "N", "throttle": "1", "out_brake_mpa": "MPa"}
    assert {name: variables[name].unit for name in expected} == expected
    pressure = units["MPa"].baseUnit
    assert (pressure.kg, pressure.m, pressure.s) == (1, -1, -2)
    assert pressure.factor == pytest.approx(1e6)
    for name, value in load_parameters(CAR).road._asdict().items():
        assert float(variables[f"road.{name}"].start) == value
        assert variables[f"road.{name}"].variability == "tunable"


@pytest.fixture
def fmu() -> Iterator[ExportedFmu]:
    """A new instance of the default car."""
    made = ExportedFmu(exported())
    yield made
    made.close()


def require_refused(fmu: ExportedFmu, words: str, call: Callable, *given: object) -> None:
    with pytest.raises(Exception, match="status 3"):
        call(*given)
    assert words in fmu.messages[-1]


@pytest.mark.parametrize("has_tyre_file", [False, True])
def test_a_drive_is_that_of_the_own_car_to_the_last_bit(has_tyre_file: bool) -> None:
    """Motion, place and further outputs, on a slope in the wind that change on the way."""
    name = car_with_tyre_file() if has_tyre_file else CAR
    roads = (
        RoadParameters(0.7, 0.4, -0.05, 0.1, wind_forward_mps=-8.0, wind_left_mps=6.0),
        RoadParameters(0.9, 0.8, 0.1, -0.06, wind_forward_mps=3.0, wind_left_mps=-9.0),
    )
    car = Car(OwnCar(with_road(load_parameters(name), roads[0])), 25.0)
    fmu = ExportedFmu(exported(name))
    fmu.set(v0_mps=25.0, curvature_per_m=0.002, **on_road(roads[0]))
    fmu.initialise()
    for k, control in enumerate(wandering_inputs(160)):
        if k == 80:
            car.plant.set_road(RoadAt(0.002, 0.0, *roads[1]))
            fmu.set(**on_road(roads[1]))
        state = car.advance(control, 0.002)
        expected = [*state[:3], car.s_m, state.ey_m, state.epsi_rad, *car.plant.outputs()]
        fmu.set(**control._asdict())
        fmu.step(k * 0.025, 0.025)
        assert fmu.get(*OUTPUT_FIELDS) == expected
    fmu.close()


def on_road(road: RoadParameters) -> dict[str, float]:
    """The values of the FMU's parameters."""
    return {f"road__{name}": value for name, value in road._asdict().items()}


def test_a_step_that_is_no_whole_number_of_internal_ones_is_split_into_equal_parts(
    fmu: ExportedFmu,
) -> None:
    """1.5 ms are twice 0.75 ms; 0.4 ms are one step; times need not be on any grid."""
    control, parameters = ControlInput(0.8, 0.0, 0.6), load_parameters(CAR)
    state, record, motion = settle(20.0, parameters), car_record(parameters), np.empty((2, 3))
    fmu.initialise(start_s=3.0)
    fmu.set(**control._asdict())
    time_s = 3.0
    for step_s, parts in ((0.0015, 2), (0.0004, 1), (0.001, 1), (0.002, 2)) * 20:
        fmu.step(time_s, step_s)
        time_s += step_s
        advance(state, control, record, parts, step_s / parts, motion)
    np.testing.assert_allclose(fmu.get(*STATE_FIELDS[:3]), motion[parts - 1], rtol=1e-12)
    assert fmu.get("time")[0] == pytest.approx(time_s, rel=1e-12)


def test_a_saved_state_continues_equally_also_in_another_instance(fmu: ExportedFmu) -> None:
    fmu.set(v0_mps=15.0)
    fmu.initialise()
    fmu.set(throttle=1.0, steer_rad=0.5)
    fmu.step(0.0, 0.5)
    saved = fmu.instance.getFMUstate()
    fmu.step(0.5, 0.3)
    first = fmu.get(*OUTPUT_FIELDS)
    fmu.instance.setFMUstate(saved)
    require_refused(fmu, "found NULL", fmu.instance.setFMUstate, None)
    other = ExportedFmu(exported())
    other.instance.setFMUstate(saved)
    for one in (fmu, other):
        one.step(0.5, 0.3)
        assert one.get(*OUTPUT_FIELDS) == first
    fmu.instance.freeFMUstate(saved)
    other.close()


def test_the_road_may_change_during_a_run_and_the_start_may_not(fmu: ExportedFmu) -> None:
    fmu.initialise()
    fmu.set(brake_n=300.0)
    fmu.step(0.0, 0.5)
    on_asphalt = fmu.get("out_ax_mps2")[0]
    fmu.set(road__friction_left=0.2, road__friction_right=0.2)
    fmu.step(0.5, 0.5)
    assert fmu.get("out_ax_mps2")[0] > 0.5 * on_asphalt
    require_refused(fmu, "v0_mps: expected a value before", lambda: fmu.set(v0_mps=30.0))


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("v0_mps", -1.0, "expected a speed of 0 to 70 m/s"),
        ("road.bank_rad", 3.0, "expected a slope of at most 0.7 rad"),
        ("road.grade_rad", -0.8, "expected a slope of at most 0.7 rad"),
        ("road.friction_left", 0.0, "expected a friction above 0"),
        ("steer_rad", float("nan"), "expected a finite number"),
        ("vx_mps", 3.0, "expected an input or a parameter"),
        ("time", 3.0, "expected an input or a parameter"),
    ],
)
def test_a_value_that_cannot_be_is_refused_by_name(
    fmu: ExportedFmu, name: str, value: float, words: str
) -> None:
    require_refused(fmu, f"{name}: {words}", lambda: fmu.set(**{name: value}))


def test_a_call_at_a_wrong_time_is_refused_and_changes_nothing(fmu: ExportedFmu) -> None:
    ended = "has neither failed nor ended"
    require_refused(fmu, ended, fmu.step, 0.0, 0.01)
    require_refused(fmu, ended, fmu.instance.terminate)
    require_refused(fmu, "finite start time", lambda: fmu.initialise(float("nan")))
    fmu.initialise()
    require_refused(fmu, "new or reset", fmu.instance.setupExperiment)
    for time_s, step_s, words in (
        (0.5, 0.01, "expected the time at which"),
        (0.0, 0.0, "expected a length above 0"),
        (0.0, float("nan"), "expected a length above 0"),
    ):
        require_refused(fmu, words, fmu.step, time_s, step_s)
    fmu.step(0.0, 0.01)
    require_refused(fmu, "every step ends", fmu.instance.cancelStep)
    assert fmu.instance.getRealStatus(2) == pytest.approx(0.01)  # the last successful time
    assert not fmu.instance.getBooleanStatus(3)  # terminated
    fmu.instance.terminate()
    require_refused(fmu, ended, fmu.instance.terminate)
    require_refused(fmu, ended, fmu.step, 0.01, 0.01)
    require_refused(fmu, ended, lambda: fmu.set(throttle=0.5))
    assert fmu.get("vx_mps")[0] > 0.0
    fmu.instance.reset()
    fmu.initialise()
    assert fmu.get("vx_mps", "s_m", "time") == [20.0, 0.0, 0.0]
    fmu.step(0.0, 0.01)


def test_outputs_are_known_in_the_initialisation(fmu: ExportedFmu) -> None:
    """They follow parameters that change before it ends."""
    fmu.instance.setupExperiment(startTime=0.0)
    fmu.instance.enterInitializationMode()
    assert fmu.get("vx_mps") == [20.0]
    fmu.set(v0_mps=7.0, ey0_m=0.5)
    assert fmu.get("vx_mps", "ey_m") == [7.0, 0.5]
    fmu.instance.exitInitializationMode()
    assert 1.0 <= fmu.get("out_gear")[0] <= 3.0


HOST = Path(__file__).parents[2] / "examples" / "fmu_host.c"


def test_a_c_program_drives_it_without_python(tmp_path: Path) -> None:
    """The host is examples/fmu_host.c; its run is that of the own car."""
    folder = tmp_path / "car"
    shutil.unpack_archive(exported(), folder, "zip")
    assert len(HOST.read_text("utf-8").splitlines()) <= 63
    host = tmp_path / "fmu_host"
    flags = ["-std=c99", "-Wall", "-Wextra", "-o", host]
    subprocess.run([*find_compiler(), *flags, HOST, "-ldl"], check=True)
    library = next(folder.glob("binaries/*/*.so"))
    needed = subprocess.run(
        ["readelf", "-d", library], check=True, capture_output=True, text=True
    ).stdout
    assert "python" not in needed.lower()
    ended = subprocess.run(
        [host, folder], check=True, capture_output=True, text=True, env={}, timeout=60.0
    )
    printed = np.array([[float(x) for x in line.split()] for line in ended.stdout.splitlines()])
    car = Car(OwnCar(load_parameters(CAR)), 25.0)
    expected = []
    for i in range(80):
        state = car.advance(ControlInput(0.1, 0.0, 0.0 if i < 20 else 0.5), 0.0)
        if i % 4 == 3:
            further = car.plant.outputs()
            expected.append([0.025 * (i + 1), state.vx_mps, further.ay_mps2, further.roll_rad])
    np.testing.assert_allclose(printed, expected, rtol=1e-9, atol=1e-9)


def test_the_sources_inside_compile_without_a_warning(tmp_path: Path) -> None:
    shutil.unpack_archive(exported(), tmp_path, "zip")
    [build] = ExportedFmu(exported()).description.buildConfigurations
    names = build.sourceFileSets[0].sourceFiles
    sources = [tmp_path / "sources" / name for name in names]
    assert len(sources) >= 4
    flags = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
    compile_library(sources, tmp_path / "again.so", flags)
    with pytest.raises(CompileError, match="IEEE"):
        compile_library(sources, tmp_path / "fast.so", ("-ffast-math",))


def test_a_run_has_no_error_that_the_sanitizers_find(tmp_path: Path) -> None:
    shutil.unpack_archive(exported(), tmp_path, "zip")
    flags = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    library = next(tmp_path.glob("binaries/*/*.so"))
    try:
        compile_library(sorted((tmp_path / "sources").glob("*.c")), library, flags)
    except CompileError as error:
        pytest.skip(f"the compiler has no sanitizers: {error}")
    host = [*find_compiler(), "-std=c99", *flags, "-o", tmp_path / "host", HOST, "-ldl"]
    subprocess.run(host, check=True)
    # The host ends without freeing its instance.
    environment = {"ASAN_OPTIONS": "detect_leaks=0"}
    command = [tmp_path / "host", tmp_path]
    ended = subprocess.run(
        command, check=False, capture_output=True, text=True, env=environment, timeout=120.0
    )
    assert (ended.returncode, ended.stderr) == (0, "")


def test_the_same_car_gives_the_same_bytes(tmp_path: Path) -> None:
    build_fmu(tmp_path / "again.fmu", CAR)
    assert (tmp_path / "again.fmu").read_bytes() == exported().read_bytes()


def test_a_compiler_that_fails_is_refused_with_what_it_said(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    broken = tmp_path / "broken-cc"
    broken.write_text("#!/bin/sh\necho stdio.h: no such file >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("CC", str(broken))
    with pytest.raises(ConfigError, match=r"libc6-dev(.|\n)*stdio\.h: no such file"):
        build_fmu(tmp_path / "car.fmu", CAR)


def test_an_exported_car_is_a_plant_that_drives_the_same_run() -> None:
    """Friction, speed and road reach it through the mapping file that is written beside it."""
    own = Car(open_plant(CarSettings(), 0.6), 22.0)
    fmu = Car(open_plant(CarSettings(plant=f"fmu:{exported()}"), 0.6), 22.0)
    assert fmu.state == own.state
    assert fmu.plant.road_inputs == own.plant.road_inputs
    for k, control in enumerate(wandering_inputs(200)):
        if k == 100:
            for car in (own, fmu):
                car.set_road(RoadAt(0.002, 0.0, 0.3, 0.9, 0.02, 0.03, 1.0, 2.0))
        there = [*fmu.advance(control, 0.002), *fmu.plant.outputs()]
        here = [*own.advance(control, 0.002), *own.plant.outputs()]
        np.testing.assert_allclose(there, here, rtol=1e-9, atol=1e-9)
    fmu.plant.close()


@pytest.mark.parametrize(
    ("name", "car", "words"),
    [
        ("mine.fmu", "mine.toml", "found the car file there"),
        ("car.fmu", "lorry", "car 'lorry'"),
        ("car.zip", CAR, r"ends in \.fmu"),
        ("missing/car.fmu", CAR, "can be written"),
    ],
)
def test_a_file_that_cannot_be_exported_is_refused(
    name: str, car: str, words: str, tmp_path: Path
) -> None:
    """The mapping file would replace the car file of the same name."""
    text = (resources.files("sim_bridge") / "cars" / f"{CAR}.toml").read_text("utf-8")
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(ConfigError, match=words):
        build_fmu(tmp_path / name, str(tmp_path / car) if car.endswith("toml") else car)
    assert not (tmp_path / name).exists()
    assert (tmp_path / "mine.toml").read_text() == text
