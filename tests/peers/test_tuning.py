"""The search of weights and gains."""

import json
from dataclasses import replace

import pytest

pytest.importorskip("optuna", reason="the extra [peers] is not installed")

from benchmarks import tuning
from benchmarks.rivals.scenarios import FIT, SEARCH
from rt_controller.baselines.tuned import tuned_values
from rt_controller.terminal.command_line import run_command


def test_a_search_stores_the_best_values_and_never_a_worse_one_than_the_defaults(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(tuning, "SEARCH", (replace(SEARCH[0], duration_s=0.5),))
    file = tmp_path / "found.json"
    with pytest.raises(SystemExit) as ended:
        run_command(tuning.app, ("--controller", "stanley", "--trials", "2", "--json", str(file)))
    assert ended.value.code == 0
    found = json.loads(file.read_text())
    assert found["cost"] <= found["cost_of_defaults"]
    assert found["values"].keys() == tuned_values("stanley").keys()
    assert not {each.name for each in FIT} & {each.name for each in SEARCH}
