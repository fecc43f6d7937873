"""Which code is running: the revision of the source tree, and a digest of code and libraries.

The revision is written into runs, bundles and figures. The digest is compared between processes,
so that workers of a cluster with another version of the program are refused.
"""

import hashlib
import platform
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

NOT_SOURCE = "rt_controller/models"
"""written by offline-export, so a change there does not make the source dirty"""
PACKAGES = ("rt_controller", "sim_bridge", "offline")
SUFFIXES = (".py", ".toml")
"""vehicle parameters are TOML files"""
NUMERICAL_LIBRARIES = ("numpy", "numba", "torch")


def source_revision() -> str:
    """Git revision of this package, with "-dirty" if a tracked file was changed.

    "unknown" outside a repository.
    """
    here = Path(__file__).parent
    revision = _git(here, "describe", "--always", "--abbrev=12")
    if not revision:
        return "unknown"
    paths = (":(top)", f":(top,exclude){NOT_SOURCE}")
    changed = _git(here, "status", "--porcelain", "--untracked-files=no", "--", *paths)
    return "unknown" if changed is None else revision + ("-dirty" if changed else "")


@cache
def describe_code() -> str:
    """Digest of the source, versions of the numerical libraries, architecture.

    Computed once in a process, which keeps running the code that it has loaded.
    """
    libraries = ", ".join(f"{name} {_version(name)}" for name in NUMERICAL_LIBRARIES)
    source = digest_sources(Path(__file__).parents[2])
    return f"source {source:.12}, {libraries}, {platform.machine()}"


def digest_sources(root: Path) -> str:
    """SHA-256 of the names and contents of the packages' source files below that folder."""
    digest = hashlib.sha256()
    for package in PACKAGES:
        for file in sorted((root / package).rglob("*")):
            if file.suffix in SUFFIXES:
                digest.update(f"{file.relative_to(root).as_posix()}\n".encode())
                digest.update(file.read_bytes())
    return digest.hexdigest()


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"


def _git(folder: Path, *arguments: str) -> str | None:
    """Output of git; None if it fails or is not installed."""
    try:
        answer = subprocess.run(
            ["git", "--no-optional-locks", *arguments],
            cwd=folder,
            capture_output=True,
            text=True,
            check=True,
            timeout=10,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip()
