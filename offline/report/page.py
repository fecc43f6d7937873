"""The report as one page of HTML that opens without a network."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from matplotlib.figure import Figure

from offline.bootstrap import CONFIDENCE, RESAMPLES, SEED
from offline.card import Fact
from offline.evaluation_sheets import (
    growth_sheet,
    mse_sheet,
    quantile_sheet,
    ratio_sheet,
    rms_sheet,
    road_sheets,
    size,
)
from offline.judgement import (
    FAIR_LTI,
    Judgement,
    growth_from_library,
    ratios_to_rivals,
    worst_state,
)
from offline.report import plots
from offline.report.canvas import as_svg
from offline.sheet import Sheet, cell, in_digits, sheet_as_html
from offline.test_sets import NEW_ROADS, ROBUSTNESS, TestSet

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1f2933; background: #fff;
       max-width: 1080px; margin: 2rem auto; padding: 0 1.5rem; }
h1 { font-size: 1.6rem; margin-bottom: .2rem; }
h2 { font-size: 1.2rem; margin: 2.8rem 0 .6rem; border-top: 1px solid #d9e0e7; padding-top: 1rem; }
h3 { font-size: .98rem; margin: 1.6rem 0 .4rem; }
p, li { max-width: 46rem; color: #3e4c59; }
p.note { font-size: .85rem; color: #616e7c; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .88rem; }
th, td { padding: .25rem .9rem .25rem 0; text-align: right; vertical-align: top;
         border-bottom: 1px solid #edf1f5; }
th { color: #52606d; font-weight: 600; } th i { font-weight: 400; }
th:first-child { text-align: left; white-space: nowrap; }
td small { color: #7b8794; white-space: nowrap; }
table.facts td { text-align: left; overflow-wrap: anywhere; }
figure { margin: 1rem 0; } figure svg { max-width: 100%; height: auto; }
figcaption { font-size: .85rem; color: #616e7c; max-width: 46rem; }
details { margin: .8rem 0; } summary { cursor: pointer; color: #2f6fb3; }
code { font-size: .85em; } .scroll { overflow-x: auto; }
"""


_MEANINGS = {
    "vx": "speed along the car",
    "vy": "speed across it, to the left",
    "yaw_rate": "turning rate, to the left",
    "ds": "progress along the road in one period",
    "ey": "way beside the road's line, to the left",
    "epsi": "heading against the road's line",
}


@dataclass(frozen=True, slots=True)
class Subject:
    """A model of the report, and what is known of it."""

    name: str
    facts: Sequence[Fact]


@dataclass(frozen=True, slots=True)
class Scene:
    """A manoeuvre and its drawing."""

    words: str
    drawing: Figure


@dataclass(frozen=True, slots=True)
class Contents:
    """Everything that the page shows."""

    judgement: Judgement
    judged: Sequence[Subject]
    rivals: Sequence[Subject]
    sources: Sequence[Fact]
    """data and software that it was made with"""
    lane_change: Scene | None
    """None where the data are not of the simulated car"""


def page(contents: Contents) -> str:
    """The whole page; drawings are part of it, and nothing is loaded from anywhere."""
    judgement = contents.judgement
    chapters = [
        _summary(judgement),
        _table_one(judgement),
        _ratios(judgement),
        _steps(judgement),
        _roads(judgement),
        _robustness(judgement),
        _lane_change(contents.lane_change),
        _sources(contents),
    ]
    title = f"How well {_listed(judgement.judged)} predict{'s' * (len(judgement.judged) == 1)}"
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width'>"
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>\n"
        f"<h1>{escape(title)}</h1>\n" + "\n".join(filter(None, chapters)) + "\n</body></html>\n"
    )


def _summary(judgement: Judgement) -> str:
    library = judgement.sets[0]
    seconds = judgement.dt_s * _steps_of(judgement)
    items = [f"<li>{_prose(words)}</li>" for words in _headlines(judgement)]
    names = [column.name for column in judgement.columns]
    known = [f"<i>{name}</i> {_MEANINGS[name]}" for name in names if name in _MEANINGS]
    states = f"<p>The states: {'; '.join(known)}.</p>" if known else ""
    return (
        f"<p>Models are shown one measured state, what happened right before it, and the inputs of "
        f"the next {seconds:g} s; they answer with the states of these {seconds:g} s, without "
        f"another look. Errors count in all {_steps_of(judgement)} steps of "
        f"{1000 * judgement.dt_s:g} ms, on {escape(size(library))} that no model was trained on "
        f"({escape(library.words)}).</p>{states}<ul>{''.join(items)}</ul>"
    )


def _headlines(judgement: Judgement) -> list[str]:
    """What to take home, a sentence for each model and question."""
    lines = []
    for model in judgement.judged:
        ratios = ratios_to_rivals(judgement, model)
        if FAIR_LTI in ratios:
            found = ratios[FAIR_LTI].geometric_mean
            interval = cell(found).interval
            lines.append(
                f"{model} against the best linear models: their mean squared errors are "
                f"{in_digits(float(found.value), 3)} times as large"
                f"{f' ({interval})' if interval else ''}, geometric mean over "
                f"{len(judgement.columns)} states."
            )
        for test in judgement.sets[1:]:
            growth = growth_from_library(judgement, model, test.name)
            worst = worst_state(growth)
            lines.append(
                f"{model} on {test.name}: mean squared errors "
                f"{float(growth.geometric_mean.value):.2f} times those on the library, "
                f"{float(growth.by_state.value[worst]):.2f} times in the worst state, "
                f"{judgement.columns[worst].name}."
            )
    return lines


def _table_one(judgement: Judgement) -> str:
    library = judgement.sets[0]
    roads = "".join(_titled(sheet) for sheet in road_sheets(judgement, library))
    more = f"<details><summary>For each curvature</summary>{roads}</details>" if roads else ""
    words = (
        "Mean squared errors in squared units, as in the paper's Table I, and their roots. "
        f"Intervals hold {100 * CONFIDENCE:g} % of the figures that {RESAMPLES} other draws of the "
        "same number of episodes would give: trajectories of one episode resemble each other, so "
        "whole episodes are drawn."
    )
    return _chapter(
        "Errors",
        words,
        _titled(mse_sheet(judgement, library)),
        _titled(rms_sheet(judgement, library)),
        more,
    )


def _ratios(judgement: Judgement) -> str:
    words = (
        "A ratio of 2 means that the rival's mean squared error is twice the model's. Both errors "
        "of a ratio are of the same drawn episodes, so an interval that stays above 1 is a "
        f"difference that these data show. “{FAIR_LTI}” is a rival made of two: one linear model "
        "with an offset for all roads and one for each road, whichever is better in a state."
    )
    parts = []
    for model in judgement.judged:
        parts.append(_drawn(plots.ratio_bars(judgement, model), f"Rivals against {model}."))
        parts.append(_titled(ratio_sheet(judgement, model, judgement.sets[0])))
    return _chapter("Against rivals", words, *parts)


def _steps(judgement: Judgement) -> str:
    parts = [
        _drawn(
            plots.rms_over_time(judgement),
            "RMS error over the time since the last look; bands are intervals. "
            "The controller plans 0.5 s ahead.",
        )
    ]
    for model in judgement.judged:
        parts.append(
            _drawn(
                plots.quantiles_over_time(judgement, model),
                f"Absolute error of {model}: half, 90 % and 99 % of the trajectories stay below.",
            )
        )
        parts.append(_titled(quantile_sheet(judgement, model)))
    return _chapter("Error over the horizon", "", *parts)


def _roads(judgement: Judgement) -> str:
    new = judgement.find_set(NEW_ROADS)
    if not judgement.sets[0].curvatures_per_m:
        return ""
    parts = [
        _drawn(
            plots.road_heat(judgement, model),
            f"RMS error of {model} on each road, over that on all roads of the library together.",
        )
        for model in judgement.judged
    ]
    words = "Errors by the curvature of the road."
    if new is not None:
        words += (
            f" Roads with a star are in no training data of this library ({new.words}). A drive "
            "does not feel which road it is on, so laying another road under it is exact."
        )
        parts.append(_titled(growth_sheet(judgement, new)))
    return _chapter("Roads", words, *parts)


def _robustness(judgement: Judgement) -> str:
    test = judgement.find_set(ROBUSTNESS)
    if test is None:
        return ""
    words = (
        f"The same models on cars and roads that they do not know ({test.words}). They are "
        "different drives than the library's, so the figures beside it carry the chance of both."
    )
    return _chapter(
        "Other cars, other grip",
        words,
        _titled(growth_sheet(judgement, test)),
        *(_titled(ratio_sheet(judgement, model, test)) for model in judgement.judged),
    )


def _lane_change(scene: Scene | None) -> str:
    if scene is None:
        return ""
    words = (
        f"The paper's manoeuvre: {scene.words}. A preview driver steers the simulated car; the "
        "models get his inputs. They start from the measured state every 2 s, at the dotted lines, "
        "and predict on their own in between. A rival that leaves a panel has left it by its error."
    )
    return _chapter("Double lane change, open loop", words, _drawn(scene.drawing, ""))


def _sources(contents: Contents) -> str:
    sets = [_described(test) for test in contents.judgement.sets]
    rivals = [Fact(s.name, "; ".join(map(_joined, s.facts))) for s in contents.rivals]
    bootstrap = Fact("bootstrap", f"{RESAMPLES} resamples of episodes, seed {SEED}, percentiles")
    return _chapter(
        "What was judged on what",
        "",
        *(f"<h3>{escape(s.name)}</h3>{_facts(s.facts)}" for s in contents.judged),
        f"<h3>Rivals</h3>{_facts(rivals)}" if rivals else "",
        f"<h3>Test sets</h3>{_facts(sets)}",
        f"<h3>Data and software</h3>{_facts([*contents.sources, bootstrap])}",
    )


def _described(test: TestSet) -> Fact:
    words = f"{test.words}; {size(test)}; data set {test.data_sha256}"
    return Fact(test.name, words)


def _joined(fact: Fact) -> str:
    return f"{fact.name} {fact.value}"


def _steps_of(judgement: Judgement) -> int:
    first = next(iter(judgement.library.values()))
    return int(first.squared.total.shape[1])


def _chapter(title: str, words: str, *parts: str) -> str:
    intro = f"<p>{_prose(words)}</p>" if words else ""
    return f"<section><h2>{escape(title)}</h2>{intro}{''.join(parts)}</section>"


def _prose(words: str) -> str:
    return escape(words).replace(" %", "&nbsp;%")


def _titled(sheet: Sheet) -> str:
    return f"<h3>{escape(sheet.title)}</h3><div class='scroll'>{sheet_as_html(sheet)}</div>"


def _drawn(drawing: Figure, caption: str) -> str:
    under = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f"<figure role='img' aria-label='{escape(caption)}'>{as_svg(drawing)}{under}</figure>"


def _facts(facts: Sequence[Fact]) -> str:
    rows = "".join(f"<tr><th>{escape(f.name)}</th><td>{escape(f.value)}</td></tr>" for f in facts)
    return f"<table class='facts'>{rows}</table>"


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
