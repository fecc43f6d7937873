"""The controller as an FMU: what it declares, how it drives, what it refuses."""

import runpy
import sys
from collections.abc import Callable
from functools import cache
from math import inf, nan
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")

import fmpy
from fmpy.simulation import instantiate_fmu
from fmpy.validation import validate_fmu
from made_models import made

from offline.commands import export
from offline.targets.fmu import write_fmu
from offline.targets.recorded_drives import RecordedLaw
from rt_controller import Bundle, ControlInput, MpcSettings, simulate
from rt_controller.contract.errors import (
    ArtifactError,
    ConfigError,
    MissingExtraError,
    RtControllerError,
)
from rt_controller.contract.timing import PERIOD_S
from rt_controller.control.program import SolveStatus
from rt_controller.native.planner import NativePlanner

EXAMPLE = Path(__file__).parents[3] / "examples" / "controller_fmu.py"
ROLLING = {"vx_mps": 20.0, "ds_m": 0.5, "path.v_mps": 20.0, "ey_m": 0.3}


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU of the shipped model, made once."""
    made_file = tmp_path_factory.mktemp("fmu") / "controller.fmu"
    write_fmu(made_file, Bundle.load("mdk-net"), MpcSettings())
    return made_file


@cache  # a library that is loaded must not be overwritten
def extracted(file: Path) -> str:
    """The folder of its content."""
    return str(fmpy.extract(str(file), str(file.with_suffix(""))))


class Fmu:
    """One instance; a call that is refused raises, with what the FMU logged in `messages`."""

    def __init__(self, file: Path) -> None:
        description = fmpy.read_model_description(str(file))
        self.messages: list[str] = []
        self.variables = {each.name: each for each in description.modelVariables}
        self.calls: Any = instantiate_fmu(
            extracted(file),
            description,
            "CoSimulation",
            logger=lambda *words: self.messages.append(str(words[-1])),
        )
        self.step = self.calls.doStep

    def set(self, **values: float) -> None:
        for name, value in values.items():
            variable = self.variables[name]
            getattr(self.calls, f"set{variable.type}")([variable.valueReference], [value])

    def start(self) -> "Fmu":
        """Itself, initialised, at 20 m/s."""
        self.calls.setupExperiment()
        self.calls.enterInitializationMode()
        self.calls.exitInitializationMode()
        self.set(**ROLLING)
        return self

    def get(self, name: str) -> float:
        variable = self.variables[name]
        return getattr(self.calls, f"get{variable.type}")([variable.valueReference])[0]

    def control(self, step_s: float = PERIOD_S) -> ControlInput:
        """The command after one more step."""
        self.step(0.0, step_s)
        return ControlInput(*map(self.get, ControlInput._fields))


@pytest.fixture
def fmu(file: Path) -> Fmu:
    """A new instance that is started."""
    return Fmu(file).start()


def test_fmpy_finds_no_problem_and_every_variable_has_a_description_and_a_unit(file: Path) -> None:
    assert validate_fmu(str(file)) == []
    description = fmpy.read_model_description(str(file))
    assert Bundle.load("mdk-net").sha256 in description.description
    units = {each.name: each.unit for each in description.modelVariables if each.type == "Real"}
    assert {each.name for each in description.unitDefinitions} == {*units.values()}
    assert all(each.description for each in description.modelVariables)
    assert [units[name] for name in ("throttle", "brake_n", "steer_rad")] == ["1", "N", "rad"]
    assert description.coSimulation.canHandleVariableCommunicationStepSize is False


def test_the_command_gives_the_same_bytes_again(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    again = tmp_path / "again.fmu"
    words = ["offline-export", "--target", "fmu", "--model", "mdk-net", "--output", str(again)]
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as ended:
        export.main()
    assert not ended.value.code
    assert again.read_bytes() == file.read_bytes()


def test_it_drives_as_the_law_in_c_and_as_the_controller_and_again_after_a_reset(
    file: Path,
) -> None:
    law = runpy.run_path(str(EXAMPLE))["FmuLaw"](file)
    driven = simulate("double_lane_change", controller=law).errors
    assert simulate("double_lane_change", controller=law).errors == driven
    in_c = RecordedLaw(NativePlanner(Bundle.load("mdk-net"), MpcSettings(), is_checked=False))
    expected = simulate("double_lane_change", controller=in_c).errors
    assert [*driven] == pytest.approx([*expected], abs=1e-9, rel=0.0)
    controller = simulate("double_lane_change").errors
    assert driven.ey_rms_m == pytest.approx(controller.ey_rms_m, abs=1e-3)
    assert driven.ey_peak_m == pytest.approx(controller.ey_peak_m, abs=1e-3)


def test_instances_do_not_disturb_each_other_and_a_reset_one_is_a_new_one(
    file: Path, fmu: Fmu
) -> None:
    expected = [fmu.control() for _ in range(5)]
    fmu.calls.reset()
    fmu.start()
    beside = Fmu(file).start()
    beside.set(ey_m=-0.5)
    for command in expected:
        assert fmu.control() == command
        assert beside.control() not in expected
    assert fmu.get("status") == SolveStatus.SOLVED.value


@pytest.mark.parametrize("name", ["vx_mps", "curvature_per_m", "path.c0_m", "preview.spacing_m"])
def test_an_input_that_is_no_number_holds_the_plan_until_it_is_one_again(
    fmu: Fmu, name: str
) -> None:
    before, usual = fmu.control(), fmu.get(name)
    fmu.set(**{name: nan})
    held = [fmu.control() for _ in range(4)]
    assert fmu.get("status") != SolveStatus.SOLVED.value
    assert all(abs(number) < inf for command in held for number in command)
    assert held[-1] == held[-2] != before
    fmu.set(**{name: usual})
    fmu.control()
    assert fmu.get("status") == SolveStatus.SOLVED.value


def test_it_begins_with_the_start_values_and_plans_over_the_delay(file: Path) -> None:
    steer_rad = []
    for delay in (0, 2):
        fmu = Fmu(file)
        fmu.set(**{"start.throttle": 0.2, "start.steer_rad": 0.1, "delay_periods": delay})
        assert fmu.get("steer_rad") == 0.1
        steer_rad.append(fmu.start().control().steer_rad)
        assert abs(fmu.get("throttle") - 0.2) < 0.1
    assert steer_rad[0] != steer_rad[1]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda fmu: fmu.step(0.0, 0.01), "step of 0.025 s"),
        (lambda fmu: fmu.step(0.0, 2.0 * PERIOD_S), "step of 0.025 s"),
        (lambda fmu: fmu.step(0.0, 0.0), "step of 0.025 s"),
        (lambda fmu: fmu.step(0.0, nan), "step of 0.025 s"),
        (lambda fmu: fmu.calls.reset() or fmu.step(0.0, PERIOD_S), "is initialised"),
        (lambda fmu: fmu.calls.terminate() or fmu.step(0.0, PERIOD_S), "has not ended"),
        (lambda fmu: fmu.calls.enterInitializationMode(), "new or reset"),
        (lambda fmu: fmu.set(throttle=0.5), "of this type and causality"),
        (lambda fmu: fmu.set(status=0), "of this type and causality"),
        (lambda fmu: fmu.calls.getReal([99]), "of this type and causality"),
        (lambda fmu: fmu.calls.getInteger([0]), "of this type and causality"),
        (lambda fmu: fmu.set(delay_periods=1), "before the end of the initialisation"),
        (lambda fmu: fmu.set(**{"start.throttle": 0.1}), "before the end of the initialisation"),
        (lambda fmu: fmu.calls.reset() or fmu.set(delay_periods=17), "expected 0 to 16"),
        (lambda fmu: fmu.calls.reset() or fmu.set(**{"start.brake_n": nan}), "within the bounds"),
        (lambda fmu: fmu.calls.getFMUstate(), "does not offer it"),
    ],
)
def test_a_call_that_cannot_be_answered_is_refused_with_a_reason(
    fmu: Fmu, call: Callable[[Fmu], object], words: str
) -> None:
    with pytest.raises(fmpy.fmi1.FMICallException, match="status 3"):
        call(fmu)
    assert words in fmu.messages[-1]


@pytest.mark.parametrize(
    ("name", "compiler", "model", "error", "words"),
    [
        ("controller.zip", "", "lti", ConfigError, r"ends in \.fmu"),
        ("missing/controller.fmu", "", "lti", ConfigError, "can be written"),
        ("controller.fmu", "no-such-compiler", "lti", MissingExtraError, "no-such-compiler"),
        ("controller.fmu", "", "made", ArtifactError, "encoder"),
    ],
)
def test_an_fmu_that_cannot_be_made_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    compiler: str,
    model: str,
    error: type[RtControllerError],
    words: str,
) -> None:
    if compiler:
        monkeypatch.setenv("CC", compiler)
    bundle = made("bilinear") if model == "made" else Bundle.load(model)
    with pytest.raises(error, match=words):
        write_fmu(tmp_path / name, bundle, MpcSettings())
    assert not (tmp_path / name).exists()
