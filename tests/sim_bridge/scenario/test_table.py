"""Tables: values, slopes and extremes of each interpolation."""

import numpy as np
import pytest

from sim_bridge.scenario.table import Interpolation, Ramp, Table, chained, constant, joined, through

X, Y = (0.0, 10.0, 15.0, 40.0), (1.0, 3.0, -2.0, 0.5)
PLACES = np.linspace(-5.0, 50.0, 400)


@pytest.mark.parametrize("interpolation", list(Interpolation))
def test_a_table_has_its_knots_slopes_extremes_and_its_mirror(interpolation: Interpolation) -> None:
    table = through(X, Y, interpolation)
    np.testing.assert_allclose(table(np.array(X)), Y, atol=1e-12)
    assert table.at(-3.0) == pytest.approx(Y[0])
    assert table.at(100.0) == pytest.approx(Y[-1])
    assert [table.at(x) for x in PLACES] == pytest.approx(table(PLACES).tolist())
    for x in (1.0, 7.3, 12.0, 33.3):
        found = (table.at(x + 1e-5) - table.at(x - 1e-5)) / 2e-5
        assert table.slope_at(x) == pytest.approx(found, abs=1e-6)
    values = table(np.linspace(0.0, 40.0, 40_001))
    assert table.lowest().value == pytest.approx(values.min(), abs=1e-5)
    assert table.highest().value == pytest.approx(values.max(), abs=1e-5)
    assert table.at(table.highest().x) == pytest.approx(table.highest().value)
    inside = np.linspace(0.01, 29.99, 200)
    np.testing.assert_allclose(table.backwards(30.0)(30.0 - inside), table(inside), atol=1e-9)


def test_linear_and_step_tables_have_the_expected_values_between() -> None:
    assert through(X, Y).at(5.0) == pytest.approx(2.0)
    assert through(X, Y).slope_at(12.0) == pytest.approx(-1.0)
    assert through(X, Y, Interpolation.STEP).at(9.999) == 1.0


def test_ramps_in_a_row_may_jump() -> None:
    table = chained([Ramp(10.0, 0.0, 1.0), Ramp(5.0, 3.0, 3.0)], start=2.0)
    assert [table.at(x) for x in (0.0, 7.0, 12.0, 16.0, 99.0)] == pytest.approx([0, 0.5, 3, 3, 3])


def test_joined_tables_follow_each_other() -> None:
    tables: list[Table] = [through(X, Y), constant(7.0), through((0.0, 5.0), (1.0, 2.0))]
    table = joined(tables, [12.0, 3.0, 5.0])
    found = [table.at(x) for x in (5.0, 11.9, 13.0, 17.5, 30.0)]
    assert found == pytest.approx([2.0, tables[0].at(11.9), 7.0, 1.5, 2.0])


def test_a_table_that_begins_later_is_constant_before() -> None:
    late = through((4.0, 6.0), (1.0, 3.0))
    row = joined([through((0.0, 9.0), (0.0, 9.0)), late], [5.0, 10.0])
    assert [row.at(x) for x in (4.9, 5.0, 8.9, 10.0, 14.0)] == pytest.approx([4.9, 1, 1, 2, 3])
    backwards = late.backwards(10.0)
    assert [backwards.at(x) for x in (3.0, 5.0, 7.0, 9.9)] == pytest.approx([3, 2, 1, 1])
