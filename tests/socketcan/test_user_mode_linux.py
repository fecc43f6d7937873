"""The tests of the folder `kernel`, on a real Linux kernel with CAN."""

import sys
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest
import user_mode_linux
from user_mode_linux import INSTALL, REQUIRED, require_programs

from rt_controller import simulate

_KERNEL_TESTS = "tests/socketcan/kernel"
_PROCESSOR_SPEED = 8
"""the two processes share one simulated processor, and each of its system calls costs 10 us"""
_TIMEOUT_S = 1800.0


def pytest_arguments(*further: str) -> list[str]:
    plugins = ("xdist", "hypothesispytest", "benchmark", "cacheprovider")
    return [
        *(sys.executable, "-m", "pytest", "-q", "--color=no", "--import-mode=importlib"),
        *("-o", "addopts=", "-o", "python_files=check_*.py"),
        *(part for plugin in plugins for part in ("-p", f"no:{plugin}")),
        *further,
    ]


@pytest.mark.nightly
def test_all_checks_pass_on_a_kernel_with_can(tmp_path: Path) -> None:
    require_programs()
    simulate("straight", model="lti", duration_s=0.1)  # compiles the car here, not in the guest
    command = pytest_arguments("--junitxml=/run/results/tests.xml", _KERNEL_TESTS)
    ended = user_mode_linux.run(command, tmp_path / "guest", _PROCESSOR_SPEED, _TIMEOUT_S)
    assert ended.status == 0, ended.console
    tests = Xml.parse(tmp_path / "guest" / "results" / "tests.xml").getroot().iter("testcase")
    passed = [test.get("name") for test in tests if len(test) == 0]
    assert len(passed) >= len(list(Path(_KERNEL_TESTS).glob("check_*.py")))


def test_a_missing_program_skips_a_test_and_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv(REQUIRED, raising=False)
    with pytest.raises(pytest.skip.Exception, match=INSTALL):
        require_programs()


def test_a_missing_program_fails_a_test_that_is_required(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv(REQUIRED, "1")
    with pytest.raises(pytest.fail.Exception, match=INSTALL):
        require_programs()


def test_a_kernel_that_does_not_start_has_no_status(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """So the test above fails: there is nothing that could skip it."""
    kernel = tmp_path / "linux.uml"
    kernel.write_text("#!/bin/sh\necho Kernel panic\nexit 1\n")
    kernel.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    ended = user_mode_linux.run(["true"], tmp_path / "guest", 1, 10.0)
    assert ended.status is None
    assert "Kernel panic" in ended.console


def test_the_continuous_integration_requires_the_kernel_and_installs_it() -> None:
    script = Path(".ci/run")
    if not script.exists():
        pytest.skip("not in a checkout")
    text = script.read_text("utf-8")
    assert f"export {REQUIRED}=1" in text
    for package in INSTALL.split()[2:]:
        assert package in text
