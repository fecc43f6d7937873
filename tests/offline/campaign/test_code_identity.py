"""Two programs are told apart by whatever their numbers follow from."""

import shutil
from pathlib import Path

import pytest

from offline import code_identity
from offline.code_identity import SOURCES, digest_sources

ROOT = Path(code_identity.__file__).parent.parent


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("copy")
    for package in SOURCES:
        without = shutil.ignore_patterns("__pycache__", "models")
        shutil.copytree(ROOT / package, root / package, ignore=without)
    return root


def test_a_copy_elsewhere_is_the_same_program(copy):
    assert digest_sources(copy) == digest_sources(ROOT)


@pytest.mark.parametrize("name", ["plant/vehicle.py", "cars/c_class_150kw_awd.toml"])
def test_another_plant_or_another_car_is_another_program(copy, name):
    file = copy / "sim_bridge" / name
    before = file.read_bytes()
    file.write_bytes(before + b"\n# heavier\n")
    try:
        assert digest_sources(copy) != digest_sources(ROOT)
    finally:
        file.write_bytes(before)


def test_a_renamed_file_is_another_program(copy):
    file = copy / "sim_bridge" / "frenet.py"
    renamed = file.rename(file.with_name("frenet_serret.py"))
    try:
        assert digest_sources(copy) != digest_sources(ROOT)
    finally:
        renamed.rename(file)
