"""What the exported FMU computes and what it refuses."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")

from c_compiler import needs_c_compiler
from exported_fmu import CAR, ExportedFmu, car_with_tyre_file, exported

from rt_controller.contract.signals import ControlInput
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.car import Car
from sim_bridge.fmu_export.description import OUTPUT_FIELDS, STATE_FIELDS
from sim_bridge.plant.car_record import car_record
from sim_bridge.plant.library import advance, settle
from sim_bridge.plant.parameters import load_parameters, with_road
from sim_bridge.plant.parts import RoadParameters
from sim_bridge.plant.protocol import RoadAt

pytestmark = needs_c_compiler


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


def inputs(n_periods: int) -> list[ControlInput]:
    rng = np.random.default_rng(0)
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
    fmu.set(v0_mps=25.0, curvature_per_m=0.002, **on_road(roads[0]))
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


def test_an_input_acts_on_motion_and_place_with_the_next_step(fmu: ExportedFmu) -> None:
    """As the empty dependencies of these outputs declare."""
    fmu.initialise()
    fmu.set(throttle=0.3, steer_rad=0.4)
    fmu.step(0.0, 0.2)
    before = fmu.get(*STATE_FIELDS)
    fmu.set(throttle=1.0, brake_n=100.0, steer_rad=-0.5, curvature_per_m=0.01)
    assert fmu.get(*STATE_FIELDS) == before
    fmu.step(0.2, 0.1)
    assert fmu.get(*STATE_FIELDS) != before


def test_outputs_are_known_in_the_initialisation(fmu: ExportedFmu) -> None:
    """They follow parameters that change before it ends."""
    fmu.instance.setupExperiment(startTime=0.0)
    fmu.instance.enterInitializationMode()
    assert fmu.get("vx_mps") == [20.0]
    fmu.set(v0_mps=7.0, ey0_m=0.5)
    assert fmu.get("vx_mps", "ey_m") == [7.0, 0.5]
    fmu.instance.exitInitializationMode()
    assert 1.0 <= fmu.get("out_gear")[0] <= 3.0
