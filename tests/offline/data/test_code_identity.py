"""Revision of the source tree, and the digest that tells two programs apart."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from offline.data import code_identity
from offline.data.code_identity import PACKAGES, digest_sources

ROOT = Path(code_identity.__file__).parents[2]
SCRIPT = "from offline.data.code_identity import source_revision; print(source_revision())"


@pytest.fixture
def repository(tmp_path):
    """A git repository of one commit with this module and a shipped model."""

    def git(*arguments):
        author = ("-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false")
        subprocess.run(["git", *author, *arguments], cwd=tmp_path, check=True, capture_output=True)

    room = tmp_path / "offline" / "data"
    room.mkdir(parents=True)
    shutil.copy(Path(code_identity.__file__), room)
    (tmp_path / "offline" / "__init__.py").touch()
    (room / "__init__.py").touch()
    (tmp_path / "rt_controller" / "models" / "lti").mkdir(parents=True)
    (tmp_path / "rt_controller" / "models" / "lti" / "card.md").write_text("# a card\n")
    git("init", "-q")
    git("add", ".")
    git("commit", "-q", "-m", "first")
    return tmp_path


def revision_in(repository):
    command = [sys.executable, "-c", SCRIPT]
    run = subprocess.run(command, cwd=repository, check=True, capture_output=True, text=True)
    return run.stdout.strip()


def test_the_revision_of_an_unchanged_tree_is_that_of_its_commit(repository):
    found = revision_in(repository)
    assert len(found) == 12
    assert int(found, 16) >= 0


def test_untracked_files_and_exported_models_do_not_make_the_revision_dirty(repository):
    clean = revision_in(repository)
    (repository / "figures.json").write_text("{}")
    (repository / "rt_controller" / "models" / "lti" / "card.md").write_text("# another card\n")
    assert revision_in(repository) == clean


def test_a_changed_source_file_makes_the_revision_dirty(repository):
    clean = revision_in(repository)
    (repository / "offline" / "__init__.py").write_text("X = 1\n")
    assert revision_in(repository) == clean + "-dirty"


def test_the_revision_outside_a_repository_is_unknown(repository):
    shutil.rmtree(repository / ".git")
    assert revision_in(repository) == "unknown"


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    """A copy of the packages' sources in another folder."""
    root = tmp_path_factory.mktemp("copy")
    for package in PACKAGES:
        without = shutil.ignore_patterns("__pycache__", "models")
        shutil.copytree(ROOT / package, root / package, ignore=without)
    return root


def test_a_copy_in_another_folder_has_the_same_digest(copy):
    assert digest_sources(copy) == digest_sources(ROOT)


@pytest.mark.parametrize("name", ["plant/vehicle.py", "cars/c_class_150kw_awd.toml"])
def test_a_changed_plant_or_car_file_changes_the_digest(copy, name):
    file = copy / "sim_bridge" / name
    before = file.read_bytes()
    file.write_bytes(before + b"\n# heavier\n")
    try:
        assert digest_sources(copy) != digest_sources(ROOT)
    finally:
        file.write_bytes(before)


def test_a_renamed_file_changes_the_digest(copy):
    file = copy / "sim_bridge" / "frenet.py"
    renamed = file.rename(file.with_name("frenet_serret.py"))
    try:
        assert digest_sources(copy) != digest_sources(ROOT)
    finally:
        renamed.rename(file)
