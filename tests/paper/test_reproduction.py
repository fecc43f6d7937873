"""`python -m benchmarks.paper`: the printed numbers, one element alone, and the tables of docs."""

import json
import re
from pathlib import Path

import pytest

from benchmarks.figures import __main__ as figures
from benchmarks.figures.results import PAPER_ELEMENTS, hashes_of
from benchmarks.paper import __main__ as paper
from benchmarks.paper import elements
from rt_controller.model.artifact import SHIPPED_MODEL
from rt_controller.terminal.command_line import run_command

TABLE_II = """
MDK-Net    2.908     0.020  0.445  0.00045  2.504   0.761
LTI model  6937.684  0.548  3.139  0.2305   39.303  11.242
"""
"""as printed: v_x, v_y, yaw rate, progress, e_y, e_psi"""


def run(app, *options: str) -> int:
    with pytest.raises(SystemExit) as ended:
        run_command(app, options)
    assert isinstance(ended.value.code, int | None)
    return ended.value.code or 0


def test_the_printed_numbers_are_those_of_the_paper():
    lines = [re.split(r"\s{2,}", line) for line in TABLE_II.strip().splitlines()]
    assert {name: tuple(map(float, values)) for name, *values in lines} == elements.MSE
    assert elements.COMPUTATION_S == {"LTI model": 3.2, "MDK-Net": 7.4}
    ratios = elements.mse_ratios()
    assert ratios["ey"] == pytest.approx(15.7, rel=1e-2)
    assert ratios["geometric_mean"] == pytest.approx(61.6, rel=1e-2)


def test_one_figure_is_drawn_with_its_numbers_in_json_and_on_the_page(tmp_path, capsys):
    file = tmp_path / "figures.json"
    options = ("--only", "figure-4", "computation-time", "table-1", "--json", str(file))
    assert run(paper.app, *options, "--output", str(tmp_path / "out")) == 0
    found = json.loads(file.read_text())
    rows = found["figure-4"]["tables"]["paper_closed_loop"]
    assert 0.0 < rows["mdk-net"]["ey_rms_m"] < rows["lti"]["ey_rms_m"]
    assert found["table-1"]["summary"]["equal hyperparameters"] == {"here": 13, "paper": 13}
    time = found["computation-time"]["summary"]["400 steps with lti, s"]
    assert time["paper"] == 3.2
    assert time["here"] > 0.0
    assert (tmp_path / "out" / "figure-4.svg").read_text().startswith("<svg")
    assert "Table I: equal hyperparameters" in capsys.readouterr().out
    page = (tmp_path / "out" / "paper.html").read_text()
    assert "<h2>Figure 4</h2>" in page
    assert "<h2>Table II</h2>" not in page


@pytest.fixture
def whole_result(tmp_path, monkeypatch) -> Path:
    """JSON of all elements, of made numbers but for the printed ones."""
    made = {f"{table}": {"mdk-net": {"vx (km/h)²": {"here": 0.25, "paper": 2.908}}}
            for table in ("paper_hyperparameters", "paper_losses", "paper_mse", "paper_mse_ratios",
                          "paper_open_loop_rms", "paper_closed_loop", "paper_times")}  # fmt: skip
    content = {name: {"tables": made} for name in PAPER_ELEMENTS}
    content |= {"overview": {"Table II": {"paper, CarSim": 61.6, "here, another car": 1.1}}}
    content |= {"model_sha256": hashes_of((SHIPPED_MODEL,))}
    file = tmp_path / "paper.json"
    file.write_text(json.dumps(content))
    return file


def test_a_table_of_the_documents_has_both_numbers(whole_result, tmp_path):
    (tmp_path / "docs").mkdir()
    text = tmp_path / "README.md"
    text.write_text("<!-- figures: paper_mse -->\n<!-- end -->\n")
    root = ("--root", str(tmp_path), "--tables")
    assert run(figures.app, *root, "--import", str(whole_result)) == 0
    assert "| mdk-net | 0.25, paper 2.908 |" in text.read_text()


def test_the_result_of_some_elements_is_no_source_of_the_documents(whole_result, tmp_path, capsys):
    content = json.loads(whole_result.read_text())
    del content["table-2"]
    whole_result.write_text(json.dumps(content))
    assert run(figures.app, "--root", str(tmp_path), "--import", str(whole_result)) != 0
    assert "expected results of" in capsys.readouterr().err
