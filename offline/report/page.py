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
    LTI_RIVALS,
    Judgement,
    growth_from_library,
    ratios_to_rivals,
    worst_state,
)
from offline.report import plots
from offline.report.html import chapter, document, drawn, facts_table, listed, prose, titled
from offline.sheet import cell, in_digits
from offline.test_sets import NEW_ROADS, ROBUSTNESS, TestSet

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
    title = f"How well {listed(judgement.judged)} predict{'s' * (len(judgement.judged) == 1)}"
    return document(title, chapters)


def _summary(judgement: Judgement) -> str:
    library = judgement.sets[0]
    seconds = judgement.dt_s * judgement.steps
    items = [f"<li>{prose(words)}</li>" for words in _headlines(judgement)]
    names = [column.name for column in judgement.columns]
    known = [f"<i>{name}</i> {_MEANINGS[name]}" for name in names if name in _MEANINGS]
    states = f"<p>The states: {'; '.join(known)}.</p>" if known else ""
    return (
        f"<p>Models are shown one measured state, what happened right before it, and the inputs of "
        f"the next {seconds:g} s; they answer with the states of these {seconds:g} s, without "
        f"seeing anything in between. Errors count in all {judgement.steps} steps of "
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
                f"{' and '.join(LTI_RIVALS)}, in each state the better of them, have mean squared "
                f"errors {in_digits(float(found.value), 3)} times those of {model}"
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
    roads = "".join(titled(sheet) for sheet in road_sheets(judgement, library))
    more = f"<details><summary>For each curvature</summary>{roads}</details>" if roads else ""
    words = (
        "Mean squared errors in squared units, as in the paper's Table I, and their roots. "
        f"Intervals hold {100 * CONFIDENCE:g} % of the figures that {RESAMPLES} other draws of the "
        "same number of episodes would give: trajectories of one episode resemble each other, so "
        "whole episodes are drawn."
    )
    return chapter(
        "Errors",
        words,
        titled(mse_sheet(judgement, library)),
        titled(rms_sheet(judgement, library)),
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
        parts.append(drawn(plots.ratio_bars(judgement, model), f"Rivals against {model}."))
        parts.append(titled(ratio_sheet(judgement, model, judgement.sets[0])))
    return chapter("Against rivals", words, *parts)


def _steps(judgement: Judgement) -> str:
    parts = [
        drawn(
            plots.rms_over_time(judgement),
            "RMS error over the time since the last look; bands are intervals. "
            "The controller plans 20 steps ahead.",
        )
    ]
    for model in judgement.judged:
        parts.append(
            drawn(
                plots.quantiles_over_time(judgement, model),
                f"Absolute error of {model}: half, 90 % and 99 % of the trajectories stay below.",
            )
        )
        parts.append(titled(quantile_sheet(judgement, model)))
    return chapter("Error over the horizon", "", *parts)


def _roads(judgement: Judgement) -> str:
    new = judgement.find_set(NEW_ROADS)
    if not judgement.sets[0].curvatures_per_m:
        return ""
    parts = [
        drawn(
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
        parts.append(titled(growth_sheet(judgement, new)))
    return chapter("Roads", words, *parts)


def _robustness(judgement: Judgement) -> str:
    test = judgement.find_set(ROBUSTNESS)
    if test is None:
        return ""
    words = (
        f"The same models on cars and roads that they do not know ({test.words}). They are "
        "different drives than the library's, so the figures beside it carry the chance of both."
    )
    return chapter(
        "Other cars, other grip",
        words,
        titled(growth_sheet(judgement, test)),
        *(titled(ratio_sheet(judgement, model, test)) for model in judgement.judged),
    )


def _lane_change(scene: Scene | None) -> str:
    if scene is None:
        return ""
    words = (
        f"The paper's manoeuvre: {scene.words}. A preview driver steers the simulated car; the "
        "models get his inputs. They start from the measured state every 2 s, at the dotted lines, "
        "and predict on their own in between. A rival that leaves a panel left it by its error. Of "
        "the rivals the linear models and the paper's network are shown."
    )
    return chapter("Double lane change, open loop", words, drawn(scene.drawing, ""))


def _sources(contents: Contents) -> str:
    sets = [_described(test) for test in contents.judgement.sets]
    rivals = [Fact(s.name, "; ".join(map(_joined, s.facts))) for s in contents.rivals]
    bootstrap = Fact("bootstrap", f"{RESAMPLES} resamples of episodes, seed {SEED}, percentiles")
    return chapter(
        "What was judged on what",
        "",
        *(f"<h3>{escape(s.name)}</h3>{facts_table(s.facts)}" for s in contents.judged),
        f"<h3>Rivals</h3>{facts_table(rivals)}" if rivals else "",
        f"<h3>Test sets</h3>{facts_table(sets)}",
        f"<h3>Data and software</h3>{facts_table([*contents.sources, bootstrap])}",
    )


def _described(test: TestSet) -> Fact:
    words = f"{test.words}; {size(test)}; data set {test.data_sha256}"
    return Fact(test.name, words)


def _joined(fact: Fact) -> str:
    return f"{fact.name} {fact.value}"
