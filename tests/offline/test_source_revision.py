"""Revision of the source tree."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rt_controller.contract import revision

SCRIPT = "from rt_controller.contract.revision import source_revision; print(source_revision())"


@pytest.fixture
def repository(tmp_path):
    """A git repository of one commit with this module and a shipped model."""

    def git(*arguments):
        author = ("-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false")
        subprocess.run(["git", *author, *arguments], cwd=tmp_path, check=True, capture_output=True)

    room = tmp_path / "rt_controller" / "contract"
    room.mkdir(parents=True)
    shutil.copy(Path(revision.__file__), room)
    (room / "__init__.py").touch()
    (room.parent / "__init__.py").touch()
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


def test_the_revision_is_that_of_the_commit_and_dirty_after_a_change_of_the_source(repository):
    """Untracked files and exported models are no change of the source."""
    clean = revision_in(repository)
    assert len(clean) == 12
    assert int(clean, 16) >= 0
    (repository / "figures.json").write_text("{}")
    (repository / "rt_controller" / "models" / "lti" / "card.md").write_text("# another card\n")
    assert revision_in(repository) == clean
    (repository / "rt_controller" / "contract" / "__init__.py").write_text("X = 1\n")
    assert revision_in(repository) == clean + "-dirty"
    shutil.rmtree(repository / ".git")
    assert revision_in(repository) == "unknown"
    (repository / "rt_controller" / "contract" / revision.REVISION_FILE).write_text("abc\n")
    assert revision_in(repository) == "abc"  # of the build
