"""Tables and pages of results that could not be measured."""

import re
from math import nan

import numpy as np
import pytest

from rt_controller.report.table import to_markdown
from sim_bridge.plant.protocol import PlantOutputs
from sim_bridge.validation.acceptance import TESTS, check
from sim_bridge.validation.frequency import Responses
from sim_bridge.validation.measurements import Measurements
from sim_bridge.validation.recording.comparison import compare
from sim_bridge.validation.recording.recording import Recording
from sim_bridge.validation.recording.replay import Replay
from sim_bridge.validation.recording.report import comparison_table
from sim_bridge.validation.report import acceptance_page
from sim_bridge.validation.ride import Swing
from sim_bridge.validation.run import Run
from sim_bridge.validation.signal_metrics import FrequencyResponse, StepResponse
from sim_bridge.validation.transients import Step

CAR = "c_class_150kw_awd"


def no_numbers(columns: int, rows: int = 20) -> np.ndarray:
    return np.full((rows, columns), nan)


def test_a_page_without_a_single_number_is_drawn_and_shows_dashes() -> None:
    """Of a car that failed in every test."""
    pytest.importorskip("plotly")
    run = Run(0.01, *(no_numbers(columns) for columns in (3, 3, 3, len(PlantOutputs._fields))))
    no_response = FrequencyResponse(np.linspace(0.2, 2.0, 5), *no_numbers(5, 2))
    responses = Responses(20.0, *(no_response,) * 4)
    no_step = StepResponse(nan, nan, nan)
    step = Step(run, nan, no_step, no_step)
    swing = Swing(np.arange(5.0), np.full(5, nan))
    measured = Measurements(
        results=[
            line
            for number, test in TESTS.items()
            for line in check(number, dict.fromkeys((one.name for one in test.lines), nan), CAR)
        ],
        cornering=run,
        lane_change=run,
        turns=(),
        steps=(step, step),
        dwell=(),
        braking=run,
        full_throttle=run,
        responses=(responses, responses),
        launch=run,
        coasting=run,
        swings=(swing, swing),
        stop=run,
    )
    page = acceptance_page(measured, "nothing measured")
    cells = re.findall(r"<td[^>]*>(.*?)</td>", page)
    assert "–" in cells
    assert not [cell for cell in cells if "nan" in cell.lower().split()]


def test_a_signal_that_could_not_be_compared_has_dashes() -> None:
    """Too short for a lag, and nothing recorded but zeros."""
    time_s = np.arange(0.0, 0.3, 0.01)
    zeros = np.zeros_like(time_s)
    one = compare("log", "yaw_rate_radps", zeros, zeros, 0.01, np.ones(len(zeros), dtype=bool))
    recording = Recording("log", time_s, zeros, zeros, False, ())
    text = to_markdown(comparison_table([Replay(recording, (), (one,), 0.3, 0)]))
    assert "nan" not in text
    assert text.count("–") == 4
