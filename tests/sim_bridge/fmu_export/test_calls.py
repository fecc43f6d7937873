"""The functions of the exported FMU, called as a C host calls them: also at a wrong time."""

import ctypes
import shutil
from collections.abc import Iterator
from ctypes import byref, c_char_p, c_double, c_int, c_size_t, c_uint32, c_void_p
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")

from c_compiler import needs_c_compiler
from exported_fmu import exported

pytestmark = needs_c_compiler

OK, DISCARD, ERROR = 0, 2, 3


class Host:
    """A loaded FMU with one instance; `call` returns the status of a function."""

    def __init__(self, file: Path, folder: Path) -> None:
        shutil.unpack_archive(file, folder, "zip")
        root = Xml.parse(folder / "modelDescription.xml").getroot()
        variables = root.find("ModelVariables")
        assert variables is not None
        self.references = {v.get("name"): int(v.get("valueReference", 0)) for v in variables}
        self.library = ctypes.CDLL(str(next(folder.glob("binaries/*/*.so"))))
        self.library.fmi2Instantiate.restype = c_void_p
        token = str(root.get("guid")).encode()
        self.instance = self.library.fmi2Instantiate(b"car", 1, token, b"", None, 0, 0)

    def call(self, name: str, *arguments: Any) -> int:
        status: int = self.library[f"fmi2{name}"](c_void_p(self.instance), *arguments)
        return status

    def setup(self, start_s: float = 0.0) -> int:
        """SetupExperiment of FMI 2."""
        return self.call("SetupExperiment", 0, c_double(0), c_double(start_s), 0, c_double(0))

    def enter(self, start_s: float = 0.0) -> int:
        """Until the initialisation mode."""
        return self.setup(start_s) or self.call("EnterInitializationMode")

    def initialise(self) -> None:
        assert (self.enter(), self.call("ExitInitializationMode")) == (OK, OK)

    def step(self, time_s: float) -> int:
        return self.call("DoStep", c_double(time_s), c_double(0.025), 1)

    def set(self, name: str, value: float) -> int:
        return self._access("Set", name, c_double(value))

    def get(self, name: str) -> int:
        return self._access("Get", name, c_double())

    def _access(self, kind: str, name: str, value: c_double) -> int:
        reference = c_uint32(self.references[name])
        return self.call(f"{kind}Real", byref(reference), c_size_t(1), byref(value))

    def saved(self) -> c_void_p:
        state = c_void_p(None)
        assert self.call("GetFMUstate", byref(state)) == OK
        return state

    def to_bytes(self, state: c_void_p) -> ctypes.Array[Any]:
        size = c_size_t()
        assert self.call("SerializedFMUstateSize", state, byref(size)) == OK
        room = ctypes.create_string_buffer(size.value)
        assert self.call("SerializeFMUstate", state, room, size) == OK
        return room


@pytest.fixture
def host(tmp_path: Path) -> Iterator[Host]:
    made = Host(exported(), tmp_path)
    yield made
    made.call("FreeInstance")


def test_a_run_ends_once_and_only_after_its_initialisation(host: Host) -> None:
    assert host.call("Terminate") == ERROR
    assert host.enter() == OK
    assert host.call("Terminate") == ERROR
    assert host.call("ExitInitializationMode") == OK
    assert host.step(0.0) == OK
    assert host.call("Terminate") == OK
    assert host.call("Terminate") == ERROR
    assert host.get("vx_mps") == OK
    assert host.set("throttle", 0.5) == ERROR
    assert host.step(0.025) == ERROR
    assert host.call("Reset") == OK
    host.initialise()
    assert host.step(0.0) == OK


def test_the_time_is_set_before_the_initialisation_only(host: Host) -> None:
    assert host.enter(float("nan")) == ERROR
    assert host.enter(3.0) == OK
    assert host.enter(4.0) == ERROR
    assert host.call("ExitInitializationMode") == OK
    assert host.setup(5.0) == ERROR
    assert host.step(5.0) == ERROR
    assert host.step(3.0) == OK


def test_a_state_is_freed_once_and_a_missing_one_is_ignored(host: Host) -> None:
    host.initialise()
    state = host.saved()
    for _ in range(2):
        assert host.call("FreeFMUstate", byref(state)) == OK
        assert state.value is None
    assert host.call("FreeFMUstate", c_void_p(None)) == OK
    assert host.call("SetFMUstate", state) == ERROR
    assert host.call("GetFMUstate", c_void_p(None)) == ERROR
    assert host.call("SerializeFMUstate", state, c_void_p(None), c_size_t(0)) == ERROR
    assert host.step(0.0) == OK


def test_bytes_of_another_fmu_or_of_another_size_are_refused(host: Host, tmp_path: Path) -> None:
    other = Host(exported("c_class_125kw_fwd"), tmp_path / "other")
    mine, theirs = (one.to_bytes(one.saved()) for one in (host, other))
    assert len(mine) == len(theirs)
    state = c_void_p(None)
    restore = "DeSerializeFMUstate"
    assert host.call(restore, theirs, c_size_t(len(theirs)), byref(state)) == ERROR
    assert host.call(restore, mine, c_size_t(len(mine) - 1), byref(state)) == ERROR
    assert host.call("SetFMUstate", other.saved()) == ERROR
    assert host.call(restore, mine, c_size_t(len(mine)), byref(state)) == OK
    assert host.call("SetFMUstate", state) == OK
    assert host.call("FreeFMUstate", byref(state)) == OK


def test_variables_of_another_type_are_refused_and_none_of_them_is_no_error(host: Host) -> None:
    reference, value, one, none = c_uint32(0), c_double(), c_size_t(1), c_size_t(0)
    for name in ("Integer", "Boolean", "String"):
        for kind in ("Get", "Set"):
            assert host.call(f"{kind}{name}", byref(reference), one, byref(value)) == ERROR
            assert host.call(f"{kind}{name}", None, none, None) == OK


def test_the_status_functions_answer(host: Host) -> None:
    host.initialise()
    assert host.step(0.0) == OK
    time_s, is_over, text, status = c_double(), c_int(1), c_char_p(), c_int()
    assert host.call("GetRealStatus", 2, byref(time_s)) == OK
    assert time_s.value == pytest.approx(0.025)
    assert host.call("GetBooleanStatus", 3, byref(is_over)) == OK
    assert is_over.value == 0
    assert host.call("GetStringStatus", 1, byref(text)) == DISCARD
    assert host.call("GetStatus", 0, byref(status)) == DISCARD
    assert host.call("CancelStep") == ERROR
