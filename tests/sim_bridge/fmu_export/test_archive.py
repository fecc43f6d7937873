"""The file of the exported FMU: a library without Python, sources that compile, its refusals."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")

from c_compiler import needs_c_compiler
from exported_fmu import CAR, ExportedFmu, exported

from rt_controller.contract.errors import ConfigError, MissingExtraError
from rt_controller.contract.signals import ControlInput
from sim_bridge.adapters.own_car import OwnCar
from sim_bridge.car import Car
from sim_bridge.fmu_export.archive import build_fmu
from sim_bridge.plant.compiler import CompileError, compile_library, find_compiler
from sim_bridge.plant.parameters import load_parameters

pytestmark = needs_c_compiler

HOST = Path(__file__).parents[3] / "examples" / "fmu_host.c"


@pytest.fixture
def file() -> Path:
    return exported()


def test_a_c_program_drives_it_without_python(tmp_path: Path) -> None:
    """The host is examples/fmu_host.c; its run is that of the own car."""
    folder = tmp_path / "car"
    shutil.unpack_archive(exported(), folder, "zip")
    assert len(HOST.read_text("utf-8").splitlines()) <= 63
    host = tmp_path / "fmu_host"
    flags = ["-std=c99", "-Wall", "-Wextra", "-o", host]
    subprocess.run([*find_compiler(), *flags, HOST, "-ldl"], check=True)
    library = next(folder.glob("binaries/*/*.so"))
    needed = subprocess.run(
        ["readelf", "-d", library], check=True, capture_output=True, text=True
    ).stdout
    assert "python" not in needed.lower()
    ended = subprocess.run(
        [host, folder], check=True, capture_output=True, text=True, env={}, timeout=60.0
    )
    printed = np.array([[float(x) for x in line.split()] for line in ended.stdout.splitlines()])
    car = Car(OwnCar(load_parameters(CAR)), 25.0)
    expected = []
    for i in range(80):
        state = car.advance(ControlInput(0.1, 0.0, 0.0 if i < 20 else 0.5), 0.0)
        if i % 4 == 3:
            further = car.plant.outputs()
            expected.append([0.025 * (i + 1), state.vx_mps, further.ay_mps2, further.roll_rad])
    np.testing.assert_allclose(printed, expected, rtol=1e-9, atol=1e-9)


def test_the_sources_inside_compile_without_a_warning(file: Path, tmp_path: Path) -> None:
    shutil.unpack_archive(file, tmp_path, "zip")
    [build] = ExportedFmu(file).description.buildConfigurations
    names = build.sourceFileSets[0].sourceFiles
    sources = [tmp_path / "sources" / name for name in names]
    assert len(sources) >= 4
    flags = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
    compile_library(sources, tmp_path / "again.so", flags)
    with pytest.raises(CompileError, match="IEEE"):
        compile_library(sources, tmp_path / "fast.so", ("-ffast-math",))


def test_a_run_has_no_error_that_the_sanitizers_find(file: Path, tmp_path: Path) -> None:
    shutil.unpack_archive(file, tmp_path, "zip")
    flags = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    library = next(tmp_path.glob("binaries/*/*.so"))
    try:
        compile_library(sorted((tmp_path / "sources").glob("*.c")), library, flags)
    except CompileError as error:
        pytest.skip(f"the compiler has no sanitizers: {error}")
    host = [*find_compiler(), "-std=c99", *flags, "-o", tmp_path / "host", HOST, "-ldl"]
    subprocess.run(host, check=True)
    # The host ends without freeing its instance.
    environment = {"ASAN_OPTIONS": "detect_leaks=0"}
    command = [tmp_path / "host", tmp_path]
    ended = subprocess.run(
        command, check=False, capture_output=True, text=True, env=environment, timeout=120.0
    )
    assert (ended.returncode, ended.stderr) == (0, "")


def test_the_same_car_gives_the_same_bytes(file: Path, tmp_path: Path) -> None:
    build_fmu(tmp_path / "again.fmu", CAR)
    assert (tmp_path / "again.fmu").read_bytes() == file.read_bytes()


def test_a_missing_compiler_is_refused_with_the_package_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(MissingExtraError, match="apt-get install gcc libc6-dev") as refused:
        build_fmu(tmp_path / "car.fmu", CAR)
    assert refused.value.exit_code == 3
    assert not (tmp_path / "car.fmu").exists()
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(MissingExtraError, match="CC=no-such-compiler"):
        build_fmu(tmp_path / "car.fmu", CAR)


def test_a_compiler_that_fails_is_refused_with_what_it_said(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    broken = tmp_path / "broken-cc"
    broken.write_text("#!/bin/sh\necho stdio.h: no such file >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("CC", str(broken))
    with pytest.raises(ConfigError, match=r"libc6-dev(.|\n)*stdio\.h: no such file"):
        build_fmu(tmp_path / "car.fmu", CAR)
