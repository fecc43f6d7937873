"""The cache of compiled kernels is renewed when a source file changes."""

import shutil
import subprocess
import sys
from pathlib import Path

from sim_bridge.plant import jit

CALLEE = "from room.jit import compiled\n\n@compiled\ndef part(x):\n    return {} * x\n"
CALLER = (
    "from room.jit import compiled\nfrom room.inner.part import part\n\n"
    "@compiled\ndef whole(x):\n    return 1.0 + part(x)\n"
)


def run_whole(folder: Path) -> str:
    """Result of the caller in a new interpreter, and the number of kernels from the cache."""
    program = (
        "from room.whole import whole; print(whole(1.0), sum(whole.stats.cache_hits.values()))"
    )
    answer = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, check=True, capture_output=True, text=True
    )
    return answer.stdout.strip()


def test_a_changed_callee_recompiles_its_callers(tmp_path: Path) -> None:
    """Also if it stands in a folder below."""
    room = tmp_path / "room"
    (room / "inner").mkdir(parents=True)
    shutil.copy(Path(jit.__file__), room / "jit.py")
    (tmp_path / "frenet.py").write_text("")
    (room / "inner" / "part.py").write_text(CALLEE.format("2.0"))
    (room / "whole.py").write_text(CALLER)
    assert run_whole(tmp_path) == "3.0 0"
    assert run_whole(tmp_path) == "3.0 1"
    (room / "inner" / "part.py").write_text(CALLEE.format("5.0"))
    assert run_whole(tmp_path) == "6.0 0"
