"""A controller with the shipped linear model, its scripted vehicle, and a call of the program."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from scripted_vehicle import Rig, build_rig

from rt_controller import cli
from rt_controller.config import MpcSettings
from rt_controller.control.mpc import Mpc
from rt_controller.model.artifact import load_bundle, shipped_model


@pytest.fixture(scope="session")
def mpc_of_session() -> Mpc:
    settings = MpcSettings()
    return Mpc(load_bundle(shipped_model("lti")), settings.horizon, settings.cost())


@pytest.fixture
def rig(mpc_of_session: Mpc) -> Iterator[Rig]:
    with build_rig(mpc_of_session) as built:
        yield built


@pytest.fixture
def run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str]]:
    """Call the program in this process; its exit code and what it wrote on stderr."""

    def call(*arguments: str | Path) -> tuple[int, str]:
        monkeypatch.setattr("sys.argv", ["rt-controller", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return int(ended.value.code or 0), capsys.readouterr().err

    return call
