"""A notebook shows the picture of a drive."""

import pytest

CELL = """
from rt_controller import simulate
simulate("double_lane_change", model="lti", duration_s=1.0)
"""


def test_a_drive_in_an_executed_notebook_is_a_picture_of_less_than_a_megabyte():
    pytest.importorskip("matplotlib")
    pytest.importorskip("ipykernel")
    nbclient = pytest.importorskip("nbclient")
    from nbformat.v4 import new_code_cell, new_notebook

    notebook = new_notebook(cells=[new_code_cell(CELL)])
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    (output,) = notebook.cells[0].outputs
    shown = output["data"]["text/html"]
    assert shown.startswith("<svg")
    assert "y / m" in shown
    assert "lateral error RMS" in shown
    assert len(shown) < 1_000_000
