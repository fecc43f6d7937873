"""The functions of the exported FMU, called as a C host calls them: also at a wrong time."""

import ctypes
import shutil
from collections.abc import Iterator
from ctypes import byref, c_bool, c_char_p, c_double, c_int, c_size_t, c_uint32, c_void_p
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import pytest

pytest.importorskip("fmpy", reason="the extra [fmu] is not installed")

from c_compiler import needs_c_compiler
from exported_fmu import exported

from sim_bridge.fmu_export.description import FmiVersion

pytestmark = needs_c_compiler

OK, DISCARD, ERROR = 0, 2, 3
COMMON = {
    FmiVersion.FMI2: ("FMUstate", "DeSerialize", "Real"),
    FmiVersion.FMI3: ("FMUState", "Deserialize", "Float64"),
}
"""names that differ between the versions"""


class Host:
    """A loaded FMU with one instance; `call` returns the status of a function."""

    def __init__(self, version: FmiVersion, folder: Path) -> None:
        shutil.unpack_archive(exported(version), folder, "zip")
        root = Xml.parse(folder / "modelDescription.xml").getroot()
        variables = root.find("ModelVariables")
        assert variables is not None
        self.references = {v.get("name"): int(v.get("valueReference", 0)) for v in variables}
        self.token = str(root.get("guid") or root.get("instantiationToken")).encode()
        self.library = ctypes.CDLL(str(next(folder.glob("binaries/*/*.so"))))
        self.version = version
        self.state, self.deserialize, self.real = COMMON[version]
        self.instance = self.instantiate()

    def instantiate(self, uses_events: bool = False) -> int | None:
        """The address of a new instance; None if it is refused."""
        if self.version is FmiVersion.FMI2:
            make = self.library.fmi2Instantiate
            arguments: tuple[Any, ...] = (b"car", 1, self.token, b"", None, 0, 0)
        else:
            make = self.library.fmi3InstantiateCoSimulation
            flags = (c_bool(False), c_bool(False), c_bool(uses_events), c_bool(False))
            nothing = c_void_p(None)
            rest = (nothing, c_size_t(0), nothing, nothing, nothing)
            arguments = (b"car", self.token, b"", *flags, *rest)
        make.restype = c_void_p
        address: int | None = make(*arguments)
        return address

    def call(self, name: str, *arguments: Any) -> int:
        status: int = self.library[f"fmi{self.version.value}{name}"](
            c_void_p(self.instance), *arguments
        )
        return status

    def setup(self, start_s: float = 0.0) -> int:
        """SetupExperiment of FMI 2."""
        return self.call("SetupExperiment", 0, c_double(0), c_double(start_s), 0, c_double(0))

    def enter(self, start_s: float = 0.0) -> int:
        """Until the initialisation mode."""
        if self.version is FmiVersion.FMI2:
            return self.setup(start_s) or self.call("EnterInitializationMode")
        no, zero = c_bool(False), c_double(0)
        return self.call("EnterInitializationMode", no, zero, c_double(start_s), no, zero)

    def initialise(self) -> None:
        assert (self.enter(), self.call("ExitInitializationMode")) == (OK, OK)

    def step(self, time_s: float) -> int:
        if self.version is FmiVersion.FMI2:
            return self.call("DoStep", c_double(time_s), c_double(0.025), 1)
        told = (byref(c_bool()), byref(c_bool()), byref(c_bool()), byref(c_double()))
        return self.call("DoStep", c_double(time_s), c_double(0.025), c_bool(True), *told)

    def set(self, name: str, value: float) -> int:
        return self._access("Set", name, c_double(value))

    def get(self, name: str) -> int:
        return self._access("Get", name, c_double())

    def _access(self, kind: str, name: str, value: c_double) -> int:
        reference = c_uint32(self.references[name])
        sizes = (c_size_t(1),) if self.version is FmiVersion.FMI3 else ()
        one = c_size_t(1)
        return self.call(f"{kind}{self.real}", byref(reference), one, byref(value), *sizes)

    def saved(self) -> c_void_p:
        state = c_void_p(None)
        assert self.call(f"Get{self.state}", byref(state)) == OK
        return state

    def to_bytes(self, state: c_void_p) -> ctypes.Array[Any]:
        size = c_size_t()
        assert self.call(f"Serialized{self.state}Size", state, byref(size)) == OK
        room = ctypes.create_string_buffer(size.value)
        assert self.call(f"Serialize{self.state}", state, room, size) == OK
        return room


@pytest.fixture(params=list(FmiVersion), ids=["fmi2", "fmi3"])
def host(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Host]:
    made = Host(request.param, tmp_path)
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
    if host.version is FmiVersion.FMI2:
        assert host.setup(5.0) == ERROR
    assert host.step(5.0) == ERROR
    assert host.step(3.0) == OK


def test_a_state_is_freed_once_and_a_missing_one_is_ignored(host: Host) -> None:
    host.initialise()
    state = host.saved()
    for _ in range(2):
        assert host.call(f"Free{host.state}", byref(state)) == OK
        assert state.value is None
    assert host.call(f"Free{host.state}", c_void_p(None)) == OK
    assert host.call(f"Set{host.state}", state) == ERROR
    assert host.call(f"Get{host.state}", c_void_p(None)) == ERROR
    assert host.call(f"Serialize{host.state}", state, c_void_p(None), c_size_t(0)) == ERROR
    assert host.step(0.0) == OK


def test_bytes_of_another_fmu_or_of_another_size_are_refused(host: Host, tmp_path: Path) -> None:
    other = Host(FmiVersion(5 - host.version), tmp_path / "other")
    mine, theirs = (one.to_bytes(one.saved()) for one in (host, other))
    assert len(mine) == len(theirs)
    state = c_void_p(None)
    restore = f"{host.deserialize}{host.state}"
    assert host.call(restore, theirs, c_size_t(len(theirs)), byref(state)) == ERROR
    assert host.call(restore, mine, c_size_t(len(mine) - 1), byref(state)) == ERROR
    assert host.call(f"Set{host.state}", other.saved()) == ERROR
    assert host.call(restore, mine, c_size_t(len(mine)), byref(state)) == OK
    assert host.call(f"Set{host.state}", state) == OK
    assert host.call(f"Free{host.state}", byref(state)) == OK


def test_variables_of_another_type_are_refused_and_none_of_them_is_no_error(host: Host) -> None:
    names = ["Integer", "Boolean", "String"]
    if host.version is FmiVersion.FMI3:
        whole = [f"{sign}{bits}" for sign in ("Int", "UInt") for bits in (8, 16, 32, 64)]
        names = ["Float32", "Boolean", "String", *whole]
    reference, value, one, none = c_uint32(0), c_double(), c_size_t(1), c_size_t(0)
    is_fmi3 = host.version is FmiVersion.FMI3
    for name in names:
        for kind in ("Get", "Set"):
            call = f"{kind}{name}"
            assert host.call(call, byref(reference), one, byref(value), *[one] * is_fmi3) == ERROR
            assert host.call(call, None, none, None, *[none] * is_fmi3) == OK


def test_an_fmu_without_event_mode_refuses_it(tmp_path: Path) -> None:
    host = Host(FmiVersion.FMI3, tmp_path)
    assert host.instantiate(uses_events=True) is None
    host.initialise()
    flags = [byref(c_bool()) for _ in range(5)]
    for name, arguments in (
        ("EnterEventMode", ()),
        ("UpdateDiscreteStates", (*flags, byref(c_double()))),
        ("EvaluateDiscreteStates", ()),
        ("EnterStepMode", ()),
        ("EnterConfigurationMode", ()),
        ("EnterContinuousTimeMode", ()),
    ):
        assert host.call(name, *arguments) == ERROR, name
    assert host.step(0.0) == OK
    assert host.get("vx_mps") == OK


def test_the_status_functions_of_fmi_2_answer(tmp_path: Path) -> None:
    host = Host(FmiVersion.FMI2, tmp_path)
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
