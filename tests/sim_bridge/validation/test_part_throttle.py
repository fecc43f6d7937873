"""Launch and cruise at part throttle: a shifted map is seen."""

from dataclasses import replace
from math import isnan

import numpy as np
import pytest

from sim_bridge.plant.parameters import Parameters, load_parameters
from sim_bridge.plant.protocol import PlantOutputs
from sim_bridge.validation import part_throttle
from sim_bridge.validation.acceptance import TESTS, check
from sim_bridge.validation.run import input_table, replay

NAME = "c_class_125kw_fwd"
CAR = load_parameters(NAME)


def missed(car: Parameters) -> set[str]:
    _, _, values = part_throttle.measure(car)
    return {line.name for line in check(9, values, NAME) if line.ok is False}


def test_the_shipped_car_passes_every_judged_line() -> None:
    assert missed(CAR) == set()


def test_a_map_shifted_to_more_throttle_misses_launch_torque_and_cruise() -> None:
    pedals = CAR.engine.map_throttles
    shifted = tuple(pedal**0.8 for pedal in pedals)
    assert missed(CAR._replace(engine=CAR.engine._replace(map_throttles=shifted))) == {
        line.name for line in TESTS[9].lines if line.fitted
    }


def test_more_drag_changes_the_torque_at_120_kmh_and_the_coast_down() -> None:
    aero = CAR.aero._replace(drag=1.2 * CAR.aero.drag)
    _, _, values = part_throttle.measure(CAR._replace(aero=aero))
    _, _, shipped = part_throttle.measure(CAR)
    assert "engine torque at 120 km/h" in missed(CAR._replace(aero=aero))
    coasting = "coast-down from 120 to 80 km/h"
    assert values[coasting] < 0.95 * shipped[coasting]


def test_the_torque_is_read_where_the_engine_passes_a_speed() -> None:
    """Torque 100 Nm at 2000 rpm and 10 Nm less per 100 rpm; the engine starts above 1500 rpm."""
    run = replay(CAR, 0.0, input_table(700, np.full(700, 0.2)), 0.01)
    outputs = run.outputs.copy()
    rpm = np.linspace(1600.0, 2600.0, 701)
    outputs[:, PlantOutputs._fields.index("engine_rpm")] = rpm
    outputs[:, PlantOutputs._fields.index("engine_nm")] = 300.0 - 0.1 * rpm
    made = replace(run, outputs=outputs)
    assert part_throttle.torque_at_rpm(made, 2500.0, 0.25) == pytest.approx(50.0)
    assert isnan(part_throttle.torque_at_rpm(made, 1500.0, 0.25))
    assert isnan(part_throttle.torque_at_rpm(made, 6000.0, 0.25))


def test_the_torque_is_not_read_within_a_shift() -> None:
    """2000 rpm are passed downwards in an up-shift at 6 s, and again in the new gear at 6.8 s."""
    run = replay(CAR, 0.0, input_table(800, np.full(800, 0.2)), 0.01)
    outputs = run.outputs.copy()
    columns = [PlantOutputs._fields.index(name) for name in ("gear", "engine_rpm", "engine_nm")]
    is_new = run.time_s >= 6.0
    is_shifting = is_new & (run.time_s < 6.2)
    rpm = np.where(is_new, 1800.0 + 250.0 * (run.time_s - 6.0), 2300.0)
    rpm[is_shifting] = np.linspace(2300.0, 1800.0, is_shifting.sum())
    outputs[:, columns[0]] = 2.0 + is_new
    outputs[:, columns[1]] = rpm
    outputs[:, columns[2]] = np.where(is_shifting, -20.0, 130.0)
    made = replace(run, outputs=outputs)
    assert part_throttle.torque_at_rpm(made, 2000.0, 0.25) == pytest.approx(130.0)
