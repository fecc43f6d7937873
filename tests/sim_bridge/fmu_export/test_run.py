"""What the exported FMU computes and what it refuses."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")

from c_compiler import needs_c_compiler
from exported_fmu import CAR, ExportedFmu, car_with_tyre_file, exported
from fmpy import simulate_fmu

from rt_controller.contract.signals import ControlInput
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.car import Car
from sim_bridge.fmu_export.description import OUTPUT_FIELDS, STATE_FIELDS
from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.library import STEP_S, advance, settle
from sim_bridge.plant.parameters import load_parameters, with_road
from sim_bridge.plant.parts import RoadParameters
from sim_bridge.plant.protocol import RoadAt

pytestmark = needs_c_compiler

FAILED = "status 3"


@pytest.fixture(scope="module")
def file() -> Path:
    return exported()


def inputs(n_periods: int, seed: int = 0) -> list[ControlInput]:
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(n_periods // 20):
        pedals = (float(rng.uniform(0.0, 1.0)), 0.0)
        if rng.random() < 0.4:
            pedals = (0.0, float(rng.uniform(0.0, 300.0)))
        made += [ControlInput(*pedals, float(rng.uniform(-1.5, 1.5)))] * 20
    return made


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
    fmu.set(v0_mps=25.0, **on_road(roads[0]))
    fmu.set(curvature_per_m=0.002)
    fmu.initialise()
    for k, control in enumerate(inputs(160)):
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


def test_fmpy_simulates_it(file: Path) -> None:
    times = np.arange(0.0, 2.0, 0.025)
    controls = np.zeros(
        len(times), dtype=[(name, float) for name in ("time", *ControlInput._fields)]
    )
    controls["time"], controls["throttle"] = times, 0.3
    controls["steer_rad"] = 0.2
    result = simulate_fmu(
        str(file), stop_time=2.0, output_interval=0.025, input=controls,
        start_values={"v0_mps": 18.0}, output=["vx_mps", "yaw_rate_radps"],
    )  # fmt: skip
    parameters = load_parameters(CAR)
    state = settle(18.0, parameters)
    motion = np.empty((2000, 3))
    advance(state, ControlInput(0.3, 0.0, 0.2), car_record(parameters), 2000, STEP_S, motion)
    np.testing.assert_allclose(result["vx_mps"][1:], motion[24::25, 0], rtol=1e-9)
    np.testing.assert_allclose(result["yaw_rate_radps"][1:], motion[24::25, 2], rtol=1e-9)


def test_a_step_that_is_no_whole_number_of_internal_ones_is_split_into_equal_parts(
    file: Path,
) -> None:
    """1.5 ms are twice 0.75 ms; 0.4 ms are one step; times need not be on any grid."""
    control = ControlInput(0.8, 0.0, 0.6)
    parameters = load_parameters(CAR)
    state, record = settle(20.0, parameters), car_record(parameters)
    motion = np.empty((2, 3))
    fmu = ExportedFmu(file)
    fmu.initialise(start_s=3.0)
    fmu.set(**control._asdict())
    time_s = 3.0
    for step_s, parts in ((0.0015, 2), (0.0004, 1), (0.001, 1), (0.002, 2)) * 20:
        fmu.step(time_s, step_s)
        time_s += step_s
        advance(state, control, record, parts, step_s / parts, motion)
    np.testing.assert_allclose(
        fmu.get("vx_mps", "vy_mps", "yaw_rate_radps"), motion[parts - 1], rtol=1e-12
    )
    assert fmu.get("time")[0] == pytest.approx(time_s, rel=1e-12)
    fmu.close()


def test_a_saved_state_continues_equally_also_in_another_instance(file: Path) -> None:
    fmu, other = ExportedFmu(file), ExportedFmu(file)
    fmu.set(v0_mps=15.0)
    fmu.initialise()
    fmu.set(throttle=1.0, steer_rad=0.5)
    fmu.step(0.0, 0.5)
    saved = fmu.get_state()
    fmu.step(0.5, 0.3)
    first = fmu.get(*OUTPUT_FIELDS)
    fmu.set_state(saved)
    fmu.step(0.5, 0.3)
    assert fmu.get(*OUTPUT_FIELDS) == first
    other.set_state(other.from_bytes(fmu.to_bytes(saved)))
    other.step(0.5, 0.3)
    assert other.get(*OUTPUT_FIELDS) == first
    fmu.close()
    other.close()


def test_after_a_reset_the_parameters_are_those_of_the_file(file: Path) -> None:
    fmu = ExportedFmu(file)
    fmu.set(v0_mps=31.0)
    fmu.initialise()
    assert fmu.get("vx_mps") == [31.0]
    fmu.step(0.0, 0.1)
    fmu.instance.reset()
    fmu.initialise()
    assert fmu.get("vx_mps", "s_m", "time") == [20.0, 0.0, 0.0]
    fmu.close()


def test_the_road_may_change_during_a_run_and_the_start_may_not(file: Path) -> None:
    fmu = ExportedFmu(file)
    fmu.initialise()
    fmu.set(brake_n=300.0)
    fmu.step(0.0, 0.5)
    on_asphalt = fmu.get("out_ax_mps2")[0]
    fmu.set(road__friction_left=0.2, road__friction_right=0.2)
    fmu.step(0.5, 0.5)
    assert fmu.get("out_ax_mps2")[0] > 0.5 * on_asphalt
    with pytest.raises(Exception, match=FAILED):
        fmu.set(v0_mps=30.0)
    assert "v0_mps: expected a value before the end" in fmu.messages[-1]
    fmu.close()


def test_a_step_at_another_time_or_without_length_is_refused(file: Path) -> None:
    fmu = ExportedFmu(file)
    with pytest.raises(Exception, match=FAILED):
        fmu.step(0.0, 0.01)
    assert "initialised" in fmu.messages[-1]
    fmu.initialise()
    for time_s, step_s, words in (
        (0.5, 0.01, "expected the time at which"),
        (0.0, 0.0, "expected a length above 0"),
        (0.0, float("nan"), "expected a length above 0"),
    ):
        with pytest.raises(Exception, match=FAILED):
            fmu.step(time_s, step_s)
        assert words in fmu.messages[-1]
    fmu.step(0.0, 0.01)
    fmu.close()


def test_pedals_outside_their_range_are_limited(file: Path) -> None:
    results = []
    for throttle, brake_n in ((1.0, 0.0), (1.7, -40.0)):
        fmu = ExportedFmu(file)
        fmu.initialise()
        fmu.set(throttle=throttle, brake_n=brake_n)
        fmu.step(0.0, 1.0)
        results.append(fmu.get(*OUTPUT_FIELDS))
        fmu.close()
    assert results[0] == results[1]


def test_an_input_acts_on_motion_and_place_with_the_next_step(file: Path) -> None:
    """As the empty dependencies of these outputs declare."""
    fmu = ExportedFmu(file)
    fmu.initialise()
    fmu.set(throttle=0.3, steer_rad=0.4)
    fmu.step(0.0, 0.2)
    before = fmu.get(*STATE_FIELDS)
    fmu.set(throttle=1.0, brake_n=100.0, steer_rad=-0.5, curvature_per_m=0.01)
    assert fmu.get(*STATE_FIELDS) == before
    fmu.step(0.2, 0.1)
    assert fmu.get(*STATE_FIELDS) != before
    fmu.close()


def test_outputs_are_known_in_the_initialisation(file: Path) -> None:
    """They follow parameters that change before it ends."""
    fmu = ExportedFmu(file)
    fmu.instance.setupExperiment(startTime=0.0)
    fmu.instance.enterInitializationMode()
    assert fmu.get("vx_mps") == [20.0]
    fmu.set(v0_mps=7.0, ey0_m=0.5)
    assert fmu.get("vx_mps", "ey_m") == [7.0, 0.5]
    fmu.instance.exitInitializationMode()
    assert 1.0 <= fmu.get("out_gear")[0] <= 3.0
    fmu.close()
