"""A clean tree has a clean revision, also while it writes what it is there to write."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from offline import revision

SCRIPT = "from offline.revision import source_revision; print(source_revision())"


@pytest.fixture
def tree(tmp_path):
    """A repository of one commit that has this module and a shipped model."""

    def git(*arguments):
        author = ("-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false")
        subprocess.run(["git", *author, *arguments], cwd=tmp_path, check=True, capture_output=True)

    (tmp_path / "offline").mkdir()
    shutil.copy(Path(revision.__file__), tmp_path / "offline")
    (tmp_path / "offline" / "__init__.py").touch()
    (tmp_path / "rt_controller" / "models" / "lti").mkdir(parents=True)
    (tmp_path / "rt_controller" / "models" / "lti" / "card.md").write_text("# a card\n")
    git("init", "-q")
    git("add", ".")
    git("commit", "-q", "-m", "first")
    return tmp_path


def revision_of(tree):
    command = [sys.executable, "-c", SCRIPT]
    return subprocess.run(
        command, cwd=tree, check=True, capture_output=True, text=True
    ).stdout.strip()


def test_a_clean_tree_has_the_revision_of_its_commit(tree):
    found = revision_of(tree)
    assert len(found) == 12
    assert int(found, 16) >= 0


def test_files_of_a_run_and_exported_models_leave_the_revision_clean(tree):
    clean = revision_of(tree)
    (tree / "figures.json").write_text("{}")
    (tree / "rt_controller" / "models" / "lti" / "card.md").write_text("# another card\n")
    assert revision_of(tree) == clean


def test_a_changed_source_makes_the_revision_dirty(tree):
    clean = revision_of(tree)
    (tree / "offline" / "__init__.py").write_text("X = 1\n")
    assert revision_of(tree) == clean + "-dirty"


def test_outside_of_a_repository_the_revision_is_unknown(tree):
    shutil.rmtree(tree / ".git")
    assert revision_of(tree) == "unknown"
