"""A benchmark refuses a wrong name or path before it measures anything."""

import pytest

pytest.importorskip("qpsolvers", reason="the extra [peers] is not installed")

from benchmarks.cadence import __main__ as cadence
from benchmarks.peers import __main__ as peers
from rt_controller.terminal.command_line import run_command

NO_FILE = "/no-such-folder/figures.json"


@pytest.mark.parametrize(
    ("app", "arguments", "expected"),
    [
        (cadence.app, ("--variants", "fats"), '--variants. Choose from: "default", "unprepared"'),
        (cadence.app, ("--json", NO_FILE), "--json /no-such-folder"),
        (peers.app, ("--json", NO_FILE), "--json /no-such-folder"),
        (peers.app, ("--plot", "/no-such-folder/times.svg"), "--plot /no-such-folder"),
        (peers.app, ("--plot", "times.tif"), "one of .png, .svg, .pdf"),
        (peers.app, ("--tiers", "slow"), '--tiers. Choose from: "slew", "corridor"'),
        (peers.app, ("--scenarios", "mlid"), '--scenarios. Choose from: "mild", "hard"'),
        (peers.app, ("--only", "OQSP"), "--only 'OQSP': expected one of"),
        (peers.app, ("--only", "OQSP"), "(did you mean OSQP?)"),
    ],
)
def test_a_wrong_name_or_path_is_refused_at_once(app, arguments, expected, capsys):
    with pytest.raises(SystemExit) as ended:
        run_command(app, arguments)
    assert ended.value.code == 2
    assert expected in capsys.readouterr().err
