"""The choice of a plant by options: what is accepted, and the messages of refusals."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import rt_controller.cli
from rt_controller.contract.errors import ConfigError, MissingExtraError
from rt_controller.settings import CarSettings
from sim_bridge import cli
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.adapters.plants import open_plant
from sim_bridge.scenario import load_scenario
from sim_bridge.session import build_car

DRY = load_scenario("straight").road_at(0.0, 0.0)


@pytest.mark.parametrize(
    ("choice", "words"),
    [
        ({"plant": "mine"}, "expected own, fmu:FILE.fmu, commonroad:NUMBER or model:BUNDLE"),
        ({"plant": "own:2"}, "expected own, fmu:FILE.fmu, commonroad:NUMBER or model:BUNDLE"),
        ({"plant": "fmu"}, "expected own, fmu:FILE.fmu, commonroad:NUMBER or model:BUNDLE"),
        ({"plant": "commonroad:two"}, "1, 2, 3, found 'two'"),
        ({"plant_mapping": Path("car.toml")}, "`plant_mapping`: expected `plant` fmu"),
        ({"plant": "commonroad:2", "car": "c_class_125kw_fwd"}, "`car`: expected `plant` own"),
        ({"plant": "commonroad:2", "friction_right": 0.3}, "`friction_right`: expected"),
        ({"friction": 0.0}, "friction: expected 0.05 to 1.5"),
        ({"friction_right": float("nan")}, "friction_right: expected 0.05 to 1.5"),
        ({"car": "lorry"}, "CarSettings.car: expected one of c_class_150kw_awd"),
    ],
)
def test_an_option_that_does_not_fit_the_plant_is_refused(
    choice: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        open_plant(CarSettings(**choice), DRY)
    assert words in str(refused.value)


def test_friction_of_the_command_line_overrides_the_scenario() -> None:
    for choice, wanted in (
        (CarSettings(), (0.85, 0.85)),
        (CarSettings(friction=0.4), (0.4, 0.4)),
        (CarSettings(friction_right=0.2), (0.85, 0.2)),
        (CarSettings(friction=0.9, friction_right=0.3), (0.9, 0.3)),
    ):
        scenario = load_scenario("straight").with_friction(choice.friction, choice.friction_right)
        plant = build_car(scenario, choice).plant
        assert isinstance(plant, OwnCar)
        assert tuple(plant.parameters.road[:2]) == wanted


@pytest.mark.parametrize(
    ("module", "plant", "extra"),
    [("fmpy", "fmu:car.fmu", "[fmu]"), ("vehiclemodels", "commonroad:2", "[commonroad]")],
)
def test_a_missing_extra_is_refused_by_name(
    monkeypatch: pytest.MonkeyPatch, module: str, plant: str, extra: str
) -> None:
    for name in list(sys.modules):
        if name == module or name.startswith(f"{module}."):
            monkeypatch.delitem(sys.modules, name)
    # For Python, None in sys.modules means: not installed.
    for name in (module, "vehiclemodels.init_mb"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError) as refused:
        open_plant(CarSettings(plant=plant), DRY)
    assert extra in str(refused.value)


REAL_BUS = ("rt-controller", "--bus", "socketcan", "--channel", "can0")
LOCAL = ("sim-bridge", "--bus", "local")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("sim-bridge", "--bus", "virtual"), "Use --bus local for both programs"),
        (("sim-bridge", "--bus", "soketcan"), "--bus 'soketcan': expected virtual, local,"),
        ((*LOCAL, "--plant", "fmu:nowhere.fmu"), "nowhere.fmu: expected an FMU"),
        ((*LOCAL, "--plant", "commonroad:9"), "found '9'"),
        ((*LOCAL, "--friction", "7"), "--friction: expected"),
        ((*LOCAL, "--car", "lorry"), "--car: expected one of"),
        ((*REAL_BUS, "--plant", "commonroad:2"), "--plant: expected --bus virtual"),
        ((*REAL_BUS, "--plant-mapping", "x.toml"), "--plant-mapping: expected --bus virtual"),
        ((*REAL_BUS, "--friction", "0.5"), "--friction: expected --bus virtual"),
    ],
)
def test_the_command_line_says_what_it_expected(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...], words: str,
) -> None:  # fmt: skip
    monkeypatch.setattr("sys.argv", list(arguments))
    with pytest.raises(SystemExit) as ended:
        (rt_controller.cli if arguments[0] == "rt-controller" else cli).main()
    assert ended.value.code == 2
    assert words in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(("model", "is_noted"), [("mdk-net", True), ("lti", False)])
def test_a_car_that_is_the_model_of_the_controller_is_noted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    model: str, is_noted: bool,
) -> None:  # fmt: skip
    drive = ("--bus", "virtual", "--check", "--plant", f"model:{model}")
    monkeypatch.setattr("sys.argv", ["rt-controller", *drive])
    with pytest.raises(SystemExit) as ended:
        rt_controller.cli.main()
    assert ended.value.code == 0
    assert ("the car is the model of the controller" in capsys.readouterr().err) is is_noted


def test_help_lists_options_without_importing_compiler_and_tools() -> None:
    program = (
        "import atexit, sys; from sim_bridge.cli import main;"
        "sys.argv = ['sim-bridge', '--help-all'];"
        "atexit.register(lambda: print(*sys.modules)); main()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True
    )
    text, _, modules = ended.stdout.rstrip().rpartition("\n")
    for word in ("validate", "--plant-mapping", "commonroad:NUMBER"):
        assert word in text
    tools = {"scipy", "fmpy", "vehiclemodels", "matplotlib"}
    assert not tools & set(modules.split())
    assert "sim_bridge.cli" in modules.split()
