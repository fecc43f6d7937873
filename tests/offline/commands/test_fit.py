"""`offline-fit`: the parameters of a known car from its logs, its car file, and refusals."""

import json

import numpy as np
import pytest

from offline.commands import fit, import_logs
from offline.evaluation.car_parameters import FITTED
from rt_controller.contract.errors import RtControllerError
from sim_bridge.plant.library import STEPS_PER_PERIOD, settle, simulate
from sim_bridge.plant.parameters import load_parameters

BASE = "c_class_150kw_bev"
TRUTH = {
    "steering.ratio": 15.0,
    "tyre.cornering_stiffness_npr": 130e3,
    "drive_torque_nm": 250.0,
}
UNTOLD = "brakes.pedal_mpa_per_n"
ONLY = [token for name in (*TRUTH, UNTOLD) for token in ("--only", name)]
MAPPING = """
time = { column = "time_s" }
[states]
vx_mps = { column = "vx_mps", unit = "m/s" }
yaw_rate_radps = { column = "yaw_rate_radps", unit = "rad/s" }
[inputs]
throttle = { column = "throttle", unit = "1", sampling = "held" }
brake_n = { column = "brake_n", unit = "N", sampling = "held", may_be_constant = true }
steer_rad = { column = "steer_rad", unit = "rad", sampling = "held" }
"""


def true_car():
    car = load_parameters(BASE)
    for each in FITTED:
        if each.name in TRUTH:
            car = each.put(car, TRUTH[each.name])
    return car


def write_log(path, seed):
    """40 s of pedal and steering, without braking, with the noise of usual sensors."""
    rng, car = np.random.default_rng(seed), true_car()
    k = np.arange(1600)
    phase = rng.uniform(0.0, 2.0 * np.pi, 3)
    throttle = np.clip(0.3 + 0.2 * np.sin(0.02 * k + phase[0]), 0.0, 1.0)
    steer_rad = 0.5 * np.sin(0.06 * k + phase[1]) + 0.2 * np.sin(0.15 * k + phase[2])
    inputs = np.transpose([throttle, np.zeros(len(k)), steer_rad])
    motion, _ = simulate(settle(float(rng.uniform(12.0, 20.0)), car), inputs, car)
    motion = motion[:-1:STEPS_PER_PERIOD]
    noise = rng.normal(size=(len(k), 2)) * (0.015, 0.0015)
    columns = [0.025 * k, *(motion[:, [0, 2]] + noise).T, *inputs.T]
    head = "time_s,vx_mps,yaw_rate_radps,throttle,brake_n,steer_rad"
    np.savetxt(path, np.transpose(columns), delimiter=",", header=head, comments="", fmt="%.6g")


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fit")
    (folder / "map.toml").write_text(MAPPING + "[checks]\naccept_units = true\n")
    (folder / "logs").mkdir()
    for seed in range(5):
        write_log(folder / "logs" / f"{seed}.csv", seed)
    run(import_logs.app, str(folder / "map.toml"), str(folder / "logs"), "--data", f"{folder}/data")
    return folder / "data"


def run(app, *tokens):
    assert app(tokens, result_action="return_value") in (None, 0)


def test_the_parameters_of_the_logs_are_found_and_the_car_file_has_them(data, tmp_path, capsys):
    file, figures = tmp_path / "own [b] car.toml", tmp_path / "fit.json"
    options = ("--car", BASE, "--windows", "8", "--json", str(figures), *ONLY)
    run(fit.app, str(data), str(file), *options, "--plot", str(tmp_path / "fit.png"))
    found = json.loads(figures.read_text())
    by_name = found["parameters"]
    for name, value in TRUTH.items():
        assert by_name[name]["low"] < value < by_name[name]["high"], by_name[name]
        assert by_name[name]["high"] - by_name[name]["low"] < 0.1 * value
    assert by_name[UNTOLD]["low"] is None
    assert "not told" in by_name[UNTOLD]["remark"]
    assert found["held_out"]["yaw_rate_error_percent"] < 5.0
    assert found["held_out"]["speed_error_percent"] < 3.0
    assert found["held_out_before"]["yaw_rate_error_percent"] > 10.0

    car, base = load_parameters(file), load_parameters(BASE)
    assert file.read_text().startswith(f'base = "{BASE}"')
    assert car.steering.ratio == pytest.approx(by_name["steering.ratio"]["value"])
    assert car.brakes == base.brakes
    assert car.suspension == base.suspension
    assert (tmp_path / "fit.png").stat().st_size > 10_000
    assert f"--car '{file}'" in capsys.readouterr().out


def test_a_car_of_which_the_logs_tell_nothing_differs_by_what_is_stated(data, tmp_path):
    file = tmp_path / "own.toml"
    options = ("--car", BASE, "--windows", "6", "--only", UNTOLD, "--mass-kg", "1800")
    run(fit.app, str(data), str(file), *options)
    assert load_parameters(file).body.mass_kg == pytest.approx(1800.0)
    assert load_parameters(file).brakes == load_parameters(BASE).brakes
    assert "stated" in file.read_text()
    assert "fitted" not in file.read_text()


@pytest.mark.parametrize(
    ("file", "options", "named"),
    [
        ("own.toml", ("--only", "tyre.colour"), "tyre.colour"),
        ("own.toml", ("--car", "no_such_car"), "no_such_car"),
        ("own.toml", ("--plot", "fit.txt"), "fit.txt"),
        ("own.txt", (), r"own\.txt: expected a file name that ends in \.toml"),
        ("nowhere/own.toml", (), "FITTED .*own.toml: expected a file that can be written"),
    ],
)
def test_an_option_that_does_not_fit_is_refused(data, tmp_path, file, options, named):
    with pytest.raises(RtControllerError, match=named):
        run(fit.app, str(data), str(tmp_path / file), *options)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('base = "no_such_car"\n', "no_such_car"),
        (f'base = "{BASE}"\n[body]\nmass_kg = {{ value = 1.0, source = "test" }}\n', "mass_kg"),
        (f'base = "{BASE}"\n[body]\ncolour = {{ value = 1.0, source = "test" }}\n', "colour"),
        (f'[body]\nbase = "{BASE}"\n', "Move it above"),
    ],
)
def test_a_car_file_with_a_wrong_base_or_field_is_refused(tmp_path, text, named):
    (tmp_path / "own.toml").write_text(text)
    with pytest.raises(RtControllerError, match=named):
        load_parameters(tmp_path / "own.toml")
