"""Reading a DBC that a person names."""

from pathlib import Path

import pytest

from rt_controller.mapping.car_file import find_source, load_dbc

DBC = """VERSION ""
BU_: CAR
BO_ 291 Inertial: 8 CAR
 SG_ YawRate : 7|16@0- (0.01,0) [-300|300] "°/s" CAR
"""


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8"])
def test_a_unit_is_read_in_either_encoding(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "car.dbc"
    path.write_bytes(DBC.encode(encoding))
    assert find_source("here", load_dbc(path), "YawRate").signal.unit == "°/s"
