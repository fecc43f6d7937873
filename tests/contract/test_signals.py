"""The columns of arrays have the names and the order of the contract's vectors."""

import numpy as np

from rt_controller.contract.signals import (
    MOTION,
    PATH_STATES,
    STATE_UNITS,
    ControlInput,
    InputColumn,
    StateColumn,
    VehicleState,
)


def test_columns_have_the_order_of_the_vectors() -> None:
    assert tuple(column.name for column in StateColumn) == VehicleState._fields
    assert tuple(column.name for column in InputColumn) == ControlInput._fields
    assert [*StateColumn] == [*range(len(VehicleState._fields))]
    assert len(STATE_UNITS) == len(VehicleState._fields)


def test_motion_and_path_states_are_all_states() -> None:
    state = np.arange(len(VehicleState._fields))
    np.testing.assert_array_equal(np.concatenate([state[MOTION], state[PATH_STATES]]), state)
