"""The comparison with recordings as a table and as an HTML page; nothing is judged."""

from collections.abc import Sequence
from math import isnan

from rt_controller.report.page import Page, Plot, Section, render_page
from rt_controller.report.table import NO_VALUE, Column, Row, Table, format_number
from sim_bridge.validation.recording.comparison import LARGEST_LAG_S, Comparison
from sim_bridge.validation.recording.recording import PERIOD_S
from sim_bridge.validation.recording.replay import SETTLING_S, SPEED_RATE, Replay

_COLUMNS = (
    Column("signal", is_text=True),
    Column("RMS recorded"),
    Column("RMS error"),
    Column("error", "%"),
    Column("gain"),
    Column("lag", "s"),
    Column("error at lag", "%"),
    Column("remark", is_text=True),
)
_GAINS = (1.0 / 3.0, 3.0)
"""beyond: km/h instead of m/s changes a gain by 3.6, g by 9.8, degrees by 57"""
NOTES = (
    f"Open loop: recorded steering and speed; {SETTLING_S:g} s are left out after a start. A car "
    f"that spins is started again.",
    "gain: the car over the recording; lag: the recording after the car. Printed, not judged.",
)


def doubts(one: Comparison) -> tuple[str, ...]:
    """What the figures of a signal say about its column."""
    found = (
        (one.gain < 0.0, "gain negative: wrong sign?"),
        (0.0 <= one.gain < _GAINS[0] or one.gain > _GAINS[1], "gain far from 1: wrong unit?"),
        (abs(one.lag_s) > LARGEST_LAG_S - 0.5 * PERIOD_S, "lag at the end of its search"),
    )
    return tuple(words for is_so, words in found if is_so)


def comparison_table(replays: Sequence[Replay]) -> Table:
    """One row for each signal, with a heading for each recording."""
    rows: list[Row] = []
    for replay in replays:
        spins = "1 spin" if replay.spins == 1 else f"{replay.spins} spins"
        rows.append((f"{replay.recording.name}: {replay.compared_s:.1f} s compared, {spins}",))
        rows += [
            (
                f"{one.signal} (by the pedals)" if one.signal == SPEED_RATE else one.signal,
                format_number(one.rms_recorded),
                format_number(one.rms_error, 3),
                format_number(one.error_percent, 3),
                format_number(one.gain, 3),
                NO_VALUE if isnan(one.lag_s) else f"{one.lag_s:.3f}",
                format_number(one.error_at_lag_percent, 3),
                "; ".join(doubts(one)),
            )
            for one in replay.comparisons
        ]
    return Table("", _COLUMNS, tuple(rows), NOTES)


def comparison_page(replays: Sequence[Replay], title: str) -> str:
    """The page with table and curves of each recording.

    Raises:
        MissingExtraError: the extra `report` is not installed.
    """
    from sim_bridge.validation.plots.recording import traces

    sections = tuple(
        Section(replay.recording.name, (comparison_table([replay]), Plot(traces(replay))))
        for replay in replays
    )
    return render_page(Page(title, sections))
