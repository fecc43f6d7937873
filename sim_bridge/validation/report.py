"""The page: the table of the tests and their figures in one file that opens without a network."""

from dataclasses import dataclass
from html import escape
from itertools import groupby

import plotly.graph_objects as go

from sim_bridge.validation import figures
from sim_bridge.validation.acceptance import Verdict
from sim_bridge.validation.findings import Findings

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1f2933; background: #fff;
       max-width: 1080px; margin: 2rem auto; padding: 0 1.5rem; }
h1 { font-size: 1.6rem; margin-bottom: .2rem; }
h2 { font-size: 1.15rem; margin: 2.6rem 0 .6rem; border-top: 1px solid #d9e0e7; padding-top: 1rem; }
p { max-width: 46rem; color: #52606d; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .9rem; }
th, td { padding: .22rem .8rem .22rem 0; text-align: right; border-bottom: 1px solid #edf1f5; }
th { color: #52606d; font-weight: 600; }
th:first-child, td:first-child { text-align: left; min-width: 19rem; }
th.unit, td.unit, td.verdict { text-align: left; }
td.car { padding-top: .7rem; font: .82rem ui-monospace, monospace; color: #52606d; }
.ok { color: #18794e; } .missed { color: #c02b2b; font-weight: 700; } .reported { color: #8a97a5; }
"""


@dataclass(frozen=True, slots=True)
class _Chapter:
    test: int
    title: str
    words: str


_CHAPTERS = (
    _Chapter(1, "1 · Laws", "What has to hold for any car: loads at rest, a mirrored run, half the "
             "integration step, and coasting without a gain of energy."),
    _Chapter(2, "2 · Steady-state cornering", "80 km/h, the steering wheel turning at 2 deg/s. "
             "Slopes are taken up to 0.3 g; the dashed lines have the target's slope."),
    _Chapter(3, "3 · Lane change at the limit", "120 km/h, 3.5 m aside within 25 m and back, road "
             "friction 0.85, a driver with preview. Dashed: the peaks of the reference car."),
    _Chapter(4, "4 · Cross-check", "The multi-body car of commonroad-vehicle-models against this "
             "plant with the same parameters: 22.2 m/s, ramps of the road wheel."),
    _Chapter(5, "5 · Step steer and frequency response", "Steps to 4 m/s² and sines of 15 deg at "
             "the steering wheel."),
    _Chapter(6, "6 · Sine with dwell", "80 km/h, 0.7 Hz, 0.5 s of rest in the second peak. The car "
             "has no stability control, so this is reported and not judged."),
    _Chapter(7, "7 · Braking and driving off", "150 N at the pedal from 100 km/h; full throttle "
             "from rest."),
)  # fmt: skip


def page(findings: Findings, verdicts: list[Verdict]) -> str:
    """The whole page as HTML; plotly's script is part of it, so it opens without a network."""
    drawn = {
        2: [figures.cornering(findings.cornering, verdicts)],
        3: [figures.lane_change(findings.lane_change, verdicts)],
        4: [figures.cross_check(findings.pairs)] if findings.pairs else [],
        5: [
            figures.steps(findings.transients, verdicts),
            figures.frequency(findings.transients),
        ],
        6: [figures.dwell(findings.dwell, verdicts)],
        7: [
            figures.braking(findings.longitudinal, verdicts),
            figures.driving_off(findings.longitudinal, verdicts),
        ],
    }
    chapters = [c for c in _CHAPTERS if any(v.test == c.test for v in verdicts)]
    body = "\n".join(
        _chapter(c, [v for v in verdicts if v.test == c.test], drawn.get(c.test, []))
        for c in chapters
    )
    missed = sum(v.ok is False for v in verdicts)
    judged = sum(v.ok is not None for v in verdicts)
    summary = f"{judged - missed} of {judged} lines hold; {len(verdicts) - judged} are reported."
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        f"<title>Acceptance of the car</title><style>{_STYLE}</style>"
        f"<script>{_script()}</script></head><body>\n"
        f"<h1>Acceptance of the car</h1><p>{summary}</p>\n{body}\n</body></html>\n"
    )


def _script() -> str:
    from plotly.offline import get_plotlyjs

    return str(get_plotlyjs())


def _chapter(chapter: _Chapter, verdicts: list[Verdict], drawn: list[go.Figure]) -> str:
    rows = "\n".join(
        f"<tr><td class='car' colspan='6'>{escape(car)}</td></tr>\n" + "\n".join(map(_row, lines))
        for car, lines in groupby(verdicts, key=lambda line: line.car)
    )
    plots = "\n".join(
        f.to_html(full_html=False, include_plotlyjs=False, config={"displayModeBar": False})
        for f in drawn
    )
    return (
        f"<section id='test-{chapter.test}'><h2>{escape(chapter.title)}</h2>"
        f"<p>{escape(chapter.words)}</p>"
        "<table><tr><th>line</th><th>target</th><th>reached</th><th>tolerance</th>"
        f"<th class='unit'>unit</th><th></th></tr>\n{rows}</table>\n{plots}</section>"
    )


def _row(line: Verdict) -> str:
    mark = {True: "ok", False: "missed", None: "reported"}[line.ok]
    target = "" if line.target is None else f"{line.target:.4g}"
    cells = (line.name, target, f"{line.reached:.4g}", line.tolerance or "")
    return (
        "<tr>"
        + "".join(f"<td>{escape(cell)}</td>" for cell in cells)
        + f"<td class='unit'>{escape(line.unit)}</td><td class='verdict {mark}'>{mark}</td></tr>"
    )
