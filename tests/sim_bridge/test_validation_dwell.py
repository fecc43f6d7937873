"""A car that cannot be measured gets lines that fail, not a command that breaks."""

from math import isnan, nan

from sim_bridge.plant.parameters import C_CLASS_150KW_AWD
from sim_bridge.validation.dwell import DwellSeries, measure


def test_a_car_that_never_gets_to_a_third_of_a_g_is_not_measured() -> None:
    series = measure(C_CLASS_150KW_AWD, nan)
    assert isnan(series.least_displacement_m)
    assert isnan(series.worst_left_over(1.0))


def test_without_an_amplitude_that_counts_there_is_no_displacement() -> None:
    assert isnan(DwellSeries((), 30.0).least_displacement_m)
