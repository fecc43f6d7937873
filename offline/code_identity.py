"""Which program a process is running, so that two machines do not compute two things as one.

A number does not say which code made it. A worker that was installed last month would deliver
episodes of last month's car, and nobody would see them among the others.
"""

import hashlib
import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

SOURCES = ("rt_controller", "sim_bridge", "offline")
SUFFIXES = (".py", ".toml")
"""cars are TOML files"""
NUMERICS = ("numpy", "numba", "torch")


@cache
def describe_code() -> str:
    """What the numbers of this process follow from: source, numerical libraries, architecture.

    Of the first call: a process that has run for a week still runs the code it has loaded.
    """
    libraries = ", ".join(f"{name} {_version(name)}" for name in NUMERICS)
    source = digest_sources(Path(__file__).parent.parent)
    return f"source {source:.12}, {libraries}, {platform.machine()}"


def digest_sources(root: Path) -> str:
    """SHA-256 of the packages' sources below that folder, names included."""
    digest = hashlib.sha256()
    for package in SOURCES:
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
