"""The controller drives only with models of the car's signals and period."""

from dataclasses import replace

import numpy as np
import pytest

from rt_controller.contract.errors import ArtifactError
from rt_controller.contract.signals import VEHICLE, ControlInput, Signal, VehicleState
from rt_controller.model.artifact import load_bundle, shipped_model
from rt_controller.model.bundle import Bundle
from rt_controller.model.lift import Lift
from rt_controller.model.validation import DRIVABLE_HISTORY, require_drivable


def refusal(bundle: Bundle) -> str:
    with pytest.raises(ArtifactError) as error:
        require_drivable(bundle)
    message = str(error.value)
    assert all(word in message for word in ("expected", "found", "`model`"))
    return message


@pytest.mark.parametrize("name", ["lti", "mdk-net", "mdk-net-small", "mdk-net-paper"])
def test_the_shipped_models_and_one_with_every_part_are_drivable(name, bundle):
    require_drivable(load_bundle(shipped_model(name)))
    require_drivable(bundle)  # bilinear, with curvature and history


def swapped(signals: tuple[Signal, ...]) -> tuple[Signal, ...]:
    return signals[1:] + signals[:1]


@pytest.mark.parametrize(
    ("schema", "what"),
    [
        (replace(VEHICLE, states=swapped(VEHICLE.states)), "states"),
        (replace(VEHICLE, inputs=swapped(VEHICLE.inputs)), "inputs"),
        (replace(VEHICLE, inputs=(Signal("throttle", "%"), *VEHICLE.inputs[1:])), "inputs"),
        (replace(VEHICLE, exogenous=()), "exogenous signals"),
        (replace(VEHICLE, dt_s=0.02), "period in s"),
    ],
)
def test_another_order_unit_or_period_is_refused(bundle, schema, what):
    assert f"expected {what} = " in refusal(replace(bundle, schema=schema))


def test_a_history_that_the_controller_does_not_keep_is_refused(bundle):
    lift = Lift(False, 4, ("vx_mps", "ey_m", "steer_rad"))
    assert "ey_m" in refusal(replace(bundle, lift=lift))


def test_the_history_consists_of_motion_and_inputs():
    assert (*VehicleState._fields[:3], *ControlInput._fields) == DRIVABLE_HISTORY


def test_the_schema_of_the_car_has_the_order_of_its_tuples():
    assert VEHICLE.state_names == VehicleState._fields
    assert VEHICLE.input_names == ControlInput._fields
    assert VEHICLE.exogenous_names == ("curvature_per_m",)
    assert {signal.unit for signal in VEHICLE.inputs} == {"1", "N", "rad"}
    assert np.isclose(VEHICLE.dt_s, 0.025)
