"""The guide to faults: its examples are faults, and it has every kind and every field."""

import re
import tomllib
from pathlib import Path

from sim_bridge.faults.fault import SHORTHANDS, Fault, FaultFile
from sim_bridge.faults.kinds import KINDS
from sim_bridge.faults.matrix.cases import load_cases
from sim_bridge.faults.matrix.row import MatrixRow

GUIDE = (Path(__file__).parents[3] / "docs" / "faults.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"`(\{ kind = .*? \})`", GUIDE)
FILES = re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL)


def test_every_kind_has_an_example_that_is_a_fault() -> None:
    faults = [Fault(**tomllib.loads(f"fault = {text}")["fault"]) for text in EXAMPLES]
    assert {fault.kind for fault in faults} == set(KINDS)


def test_every_short_name_field_and_column_is_in_the_guide() -> None:
    columns = MatrixRow._fields
    for name in (*SHORTHANDS, *Fault.model_fields, *columns):
        assert re.search(rf"\b{name}\b", GUIDE), name


def test_the_files_of_the_guide_are_faults_and_cases(tmp_path: Path) -> None:
    assert len(FaultFile.model_validate(tomllib.loads(FILES[0])).faults) == 2
    file = tmp_path / "cases.toml"
    file.write_text(FILES[1], encoding="utf-8")
    for case in load_cases(file):
        assert case.scenario(60.0).faults or case.initial
