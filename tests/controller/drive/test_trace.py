"""The recorder of a drive: arc length; and the drive in a notebook."""

import sys

import numpy as np
import pytest

from rt_controller.contract.signals import AT_REST, NEUTRAL_INPUT, Mode
from rt_controller.drive.trace import DriveTrace
from rt_controller.safety.tick import Tick


def test_arc_length_begins_with_the_drive_and_counts_lost_states() -> None:
    trace = DriveTrace(10)
    moving = AT_REST._replace(vx_mps=20.0, ds_m=0.5)
    for mode, is_received in (
        (Mode.STANDBY, True), (Mode.NOMINAL, True), (Mode.NOMINAL, True), (Mode.HOLD_PLAN, False),
        (Mode.NOMINAL, True), (Mode.STANDBY, True),
    ):  # fmt: skip
        state = moving if is_received else None
        trace.record(Tick(mode=mode, state=state, control=NEUTRAL_INPUT), 0)
    found = trace.drive("model", "over")["s_m"]
    np.testing.assert_allclose(found, [0.0, 0.0, 0.5, 1.0, 1.5, 2.0])


@pytest.mark.parametrize("has_matplotlib", [False, True])
def test_a_drive_in_a_notebook_shows_its_errors_and_a_figure_if_one_can_be_drawn(
    has_matplotlib: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if has_matplotlib:
        pytest.importorskip("matplotlib")
    else:
        monkeypatch.setitem(sys.modules, "matplotlib", None)
        monkeypatch.delitem(sys.modules, "rt_controller.report.canvas", raising=False)
    trace = DriveTrace(10)
    trace.record(Tick(mode=Mode.NOMINAL, state=AT_REST, control=NEUTRAL_INPUT), 0)
    shown = trace.drive("a <model>", "over")._repr_html_()
    assert "a &lt;model&gt;" in shown
    assert "<td>ey_peak_m</td>" in shown
    assert ("<svg" in shown) is has_matplotlib
