"""The tables of an evaluation, as they are printed and as the report shows them."""

from offline.bootstrap import CONFIDENCE, RESAMPLES, Estimate
from offline.evaluate import SHARES, mse, mse_on_road, quantiles_at_marks, rms
from offline.judgement import (
    FAIR_LTI,
    LTI_RIVALS,
    WORST_ON_NEW_ROADS,
    Judgement,
    growth_from_library,
    is_within_goal,
    ratios_to_rivals,
    worst_state,
)
from offline.ratios import Ratio
from offline.sheet import Cell, Sheet, cell, cells, in_digits
from offline.table_units import Column
from offline.test_sets import LIBRARY, NEW_ROADS, TestSet

INTERVALS = (
    f"Below a figure its {100 * CONFIDENCE:g} % interval: bootstrap by episode, {RESAMPLES} draws."
)


def mse_sheet(judgement: Judgement, test: TestSet) -> Sheet:
    """Mean squared errors with intervals. Paper: Table I."""
    rows = [(name, cells(mse(judgement.scores[test.name][name]))) for name in judgement.names]
    return Sheet(
        f"MSE over {judgement.steps} steps, {size(test)}",
        _state_heads("model", judgement.columns, squared=True),
        tuple(rows),
        _diverged(judgement, test) or INTERVALS,
    )


def rms_sheet(judgement: Judgement, test: TestSet) -> Sheet:
    """The same in the states' own units."""
    rows = [(name, _bare(rms(judgement.scores[test.name][name]))) for name in judgement.names]
    return Sheet(
        f"RMS error over {judgement.steps} steps, {size(test)}",
        _state_heads("model", judgement.columns),
        tuple(rows),
    )


def road_sheets(judgement: Judgement, test: TestSet) -> list[Sheet]:
    """Mean squared errors on the roads of each curvature."""
    scores = judgement.scores[test.name]
    return [
        Sheet(
            f"MSE on curvature {curvature:g} 1/m",
            _state_heads("model", judgement.columns, squared=True),
            tuple((name, _bare(mse_on_road(scores[name], curvature))) for name in judgement.names),
        )
        for curvature in test.curvatures_per_m
    ]


def ratio_sheet(judgement: Judgement, model: str, test: TestSet) -> Sheet:
    """How many times smaller the model's errors are than each rival's."""
    ratios = ratios_to_rivals(judgement, model, test.name)
    linear = " and ".join(name for name in LTI_RIVALS if name in judgement.rivals)
    note = f"{FAIR_LTI}: in each state the better of {linear}."
    return Sheet(
        f"MSE of each rival over that of {model}, {test.name}: above 1, {model} is better",
        _ratio_heads("rival", judgement.columns),
        tuple((name, _ratio_cells(one)) for name, one in ratios.items()),
        note if FAIR_LTI in ratios else "",
    )


def quantile_sheet(judgement: Judgement, model: str) -> Sheet:
    """Absolute errors at single steps: the usual, a bad and nearly the worst."""
    scores = judgement.library[model]
    at_marks = quantiles_at_marks(scores)
    rows = [
        (
            f"{step * judgement.dt_s:g} s, {'median' if share == 0.5 else f'{100 * share:g} %'}",
            cells(at_marks.at(i, j)),
        )
        for j, step in enumerate(scores.marked.steps)
        for i, share in enumerate(SHARES)
    ]
    return Sheet(
        f"Absolute error of {model} after so long: quantiles over trajectories, {LIBRARY}",
        _state_heads("after", judgement.columns),
        tuple(rows),
    )


def growth_sheet(judgement: Judgement, test: TestSet) -> Sheet:
    """How many times the errors on the library's roads every model makes on another set."""
    growths = {name: growth_from_library(judgement, name, test.name) for name in judgement.names}
    note = ""
    if test.name == NEW_ROADS:
        found = "; ".join(_worst(judgement, name, growths[name]) for name in judgement.judged)
        note = f"The goal: no state above {WORST_ON_NEW_ROADS:g}. {found}"
    return Sheet(
        f"MSE on {test.name} over MSE on {LIBRARY}, {size(test)}",
        _ratio_heads("model", judgement.columns),
        tuple((name, _ratio_cells(growth)) for name, growth in growths.items()),
        note,
    )


def size(test: TestSet) -> str:
    """How many trajectories of how many episodes."""
    return f"{test.n_trajectories} trajectories of {test.n_episodes} episodes"


def _bare(estimate: Estimate) -> tuple[Cell, ...]:
    return tuple(Cell(one.figure) for one in cells(estimate))


def _ratio_cells(ratio: Ratio) -> tuple[Cell, ...]:
    return (*cells(ratio.by_state), cell(ratio.geometric_mean))


def _state_heads(
    first: str, columns: tuple[Column, ...], squared: bool = False
) -> tuple[tuple[str, str], ...]:
    return (
        (first, ""),
        *((each.name, each.squared_unit if squared else each.unit) for each in columns),
    )


def _ratio_heads(first: str, columns: tuple[Column, ...]) -> tuple[tuple[str, str], ...]:
    return ((first, ""), *((each.name, "") for each in columns), ("geometric mean", ""))


def _worst(judgement: Judgement, model: str, growth: Ratio) -> str:
    worst = worst_state(growth)
    verdict = "reached" if is_within_goal(growth.by_state) else "missed"
    figure = in_digits(float(growth.by_state.value[worst]), 3)
    return f"{model}: {verdict}, the worst is {judgement.columns[worst].name} with {figure}"


def _diverged(judgement: Judgement, test: TestSet) -> str:
    """Which models predicted something that is no number."""
    scores = judgement.scores[test.name]
    found = [
        f"{name} on {scores[name].diverged}" for name in judgement.names if scores[name].diverged
    ]
    return f"No finite prediction from {', '.join(found)} trajectories." if found else ""
