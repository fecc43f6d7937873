"""`offline-export --target c`: the folder compiles and plans as Python does; refusals."""

import json
import subprocess
import sys

import pytest

from offline.commands import export
from offline.targets import recorded_drives

STRICT = "-O1 -Wconversion -pedantic -Werror"


@pytest.fixture
def offline_export(monkeypatch, capsys, tmp_path):
    """Runs the command, which must end with the exit code; returns what it printed."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments, code=0):
        monkeypatch.setattr(sys, "argv", ["offline-export", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_info:
            export.main()
        printed = capsys.readouterr()
        assert exit_info.value.code == code, printed.err
        return " ".join((printed.err if code else printed.out).split())

    return run


@pytest.fixture
def short_drives(monkeypatch):
    monkeypatch.setattr(recorded_drives, "SCENARIOS", (("lane_change_60", 40, 90),))


def make(folder, *arguments):
    """Figures that `make` printed."""
    done = subprocess.run(
        ["make", "-C", folder, "-s", *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return dict(line.split() for line in done.stdout.splitlines() if len(line.split()) == 2)


def test_the_shipped_model_in_c_drives_as_python_in_float_and_double(offline_export, tmp_path):
    printed = offline_export("--target", "c", "--output", "law", "--json", "law.json")
    figures = json.loads((tmp_path / "law.json").read_text())
    assert figures["precision"] == "float"
    assert figures["test"]["periods"] >= 300
    assert figures["test"]["failed"] == 0
    assert f"stack: {figures['test']['stack_bytes']:.0f} bytes" in printed
    for each in figures["sizes"]:
        assert 100_000 < each["constants_bytes"] < 300_000
        assert (
            figures["memory_numbers"] * 4 < each["ram_bytes"] < figures["memory_numbers"] * 4 + 1024
        )
    for real, largest in (("float", 1e-3), ("double", 1e-5)):
        found = make("law", "test", f"REAL={real}", f"CFLAGS={STRICT}")
        assert float(found["plan_difference"]) <= largest
        assert int(found["periods"]) == figures["test"]["periods"]


def test_the_code_of_the_readme_calls_the_law_without_options(
    offline_export, short_drives, tmp_path
):
    offline_export("--target", "c", "--model", "lti", "--output", "law")
    text = (tmp_path / "law" / "README.md").read_text()
    code = text.partition("```c\n")[2].partition("```")[0]
    (tmp_path / "main.c").write_text(
        code
        + """
int main(void) {
    mdk_situation now = {.state = {22, 0, 0, 0.55}, .path = {0, 0, 0, 0, 22}, .preview = {25}};
    start();
    return sizeof sent == 12 && every_period(&now) && sent[0] > 0 && sent[1] == 0 ? 0 : 1;
}
"""
    )
    make("law")
    build = "cc -std=c99 -Ilaw main.c law/build/float/libmdk.a -lm -o main && ./main"
    assert subprocess.run(build, shell=True, check=False).returncode == 0


def test_a_wrong_constant_fails_the_test_of_the_folder(offline_export, short_drives, tmp_path):
    offline_export("--target", "c", "--model", "lti", "--precision", "double", "--output", "law")
    model = tmp_path / "law" / "mdk_model.c"
    assert make("law", "test")["tolerance"] == "1e-05"  # of double
    text, name = model.read_text(), "model_dynamics_B[] = {\n    R("
    assert name in text
    model.write_text(text.replace(name, f"{name}0.01 + "))
    done = subprocess.run(["make", "-C", "law", "-s", "test"], capture_output=True, check=False)
    assert done.returncode != 0


def test_without_a_compiler_the_source_is_written_and_not_tested(
    offline_export, short_drives, monkeypatch, tmp_path
):
    monkeypatch.setenv("CC", "no-such-compiler")
    printed = offline_export("--target", "c", "--model", "lti", "--output", "law", "--json", "j")
    assert "needs a C compiler" in printed
    assert "make -C law test" in printed
    assert json.loads((tmp_path / "j").read_text())["test"] is None
    monkeypatch.delenv("CC")
    assert int(make("law", "test")["failed"]) == 0
    monkeypatch.setenv("CC", "no-such-compiler")
    limited = ("--target", "c", "--model", "lti", "--output", "other", "--rom-kb", 100)
    assert "--rom-kb" in offline_export(*limited, code=2)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ("c --baseline lti", "--target c: expected none of"),
        ("c runs/other", "found RUN"),
        ("c --model-trial off", "found --model-trial"),
        ("bundle --precision float", "--target bundle: expected none of"),
        ("c --model lti --rom-kb 12", "--rom-kb 12: expected a model that needs no more"),
        ("c --model lti --ram-kb 60", "--ram-kb 60: expected a model that needs no more"),
        ("c --rom-kb -1", "--rom-kb"),
        ("c --config corridor.toml", "mpc.corridor-m"),
        ("c --config none.toml", "--config none.toml"),
        ("c --output corridor.toml", "--output corridor.toml: expected a folder"),
        ("c --model no-model", "no-model"),
    ],
)
def test_refused_options_are_named_and_nothing_is_written(
    offline_export, tmp_path, arguments, named
):
    (tmp_path / "corridor.toml").write_text("[mpc]\ncorridor-m = 1.0\n")
    assert named in offline_export("--target", *arguments.split(), code=2)
    assert [file.name for file in tmp_path.iterdir()] == ["corridor.toml"]
