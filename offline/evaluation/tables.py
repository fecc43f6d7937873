"""The sentence and the tables of an evaluation, for the terminal, the model card and the page.

They are views of `Comparison.table`. The title of each table says what is compared with what, on
which trajectories.
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from offline.evaluation.bootstrap import CONFIDENCE, RESAMPLES
from offline.evaluation.comparison import FAIR_LTI, LTI_BASELINES, Comparison
from offline.evaluation.comparison import Row as Errors
from offline.evaluation.metrics import PROGRESS, mean_names
from offline.evaluation.parts import Part
from rt_controller.report.table import NO_VALUE, Cell, Column, Row, Table, format_number

INTERVAL = f"{100 * CONFIDENCE:g} % interval, bootstrap by episode, {RESAMPLES} resamples."
NO_INTERVALS = "Without intervals: they need several episodes."
_FIRST = {"ey": "lateral position", "vx": "speed"}
"""states of the first sentence, in its words; of data without them the first two"""


def headline(comparison: Comparison) -> str:
    """How far each model and the best linear baseline are off at the end of the horizon."""
    library, states = comparison.parts[0], {state.name: state for state in comparison.states}
    words = {name: text for name, text in _FIRST.items() if name in states}
    words = words or {name: name for name in [*states][:2]}

    def errors(model: str) -> str:
        at_end = dict(zip(states, comparison.by_step[model].value[-1], strict=True))
        texts = (f"{format_number(at_end[s], 2)} {states[s].unit} in {words[s]}" for s in words)
        return " and ".join(texts)

    first, *others = comparison.models
    text = (
        f"From one measurement and the inputs, {first} predicts the next "
        f"{comparison.dt_s * _steps(comparison):g} s of a drive; at their end it is off by "
        f"{errors(first)}, root mean square over {library.n_trajectories} trajectories."
    )
    text += "".join(f" {name} is off by {errors(name)}." for name in others)
    best = comparison.best_linear(library.name)
    return text + (f" The best linear model, {best}, is off by {errors(best)}." if best else "")


def screen_tables(comparison: Comparison) -> list[Table]:
    """The tables that fit on one screen: errors on the library, and whole test sets."""
    whole = [part for part in comparison.parts if part.is_whole]
    return [rms_table(comparison), *([parts_table(comparison, whole)] if whole[1:] else [])]


def all_tables(comparison: Comparison) -> list[Table]:
    """All tables: with intervals, and over every part."""
    ratios = [ratio_table(comparison)] if comparison.names[1:] else []
    parts = parts_table(comparison, comparison.parts)
    return [mse_table(comparison), rms_table(comparison), *ratios, parts]


def mse_table(comparison: Comparison) -> Table:
    """Mean squared errors on the library with intervals. Paper: Table II."""
    counts = {name: comparison.library[name][0].diverged for name in comparison.names}
    diverged = ", ".join(f"{name} on {count}" for name, count in counts.items() if count)
    note = f"Second line: {INTERVAL}" if comparison.parts[0].n_episodes > 1 else NO_INTERVALS
    return _library_table(
        comparison,
        f"MSE over {_steps(comparison)} steps of each model",
        [Column(each.symbol, each.squared_unit) for each in comparison.states],
        comparison.names,
        lambda rows: [_cell(row.mse, row.mse_low, row.mse_high) for row in rows],
        [note, *([f"No finite prediction: {diverged} trajectories."] if diverged else [])],
    )


def rms_table(comparison: Comparison, with_intervals: bool = False) -> Table:
    """Root mean square errors on the library, and the ratio of the squared ones."""

    def cells(rows: Sequence[Errors]) -> list[Cell | str]:
        *errors, mean = rows[: len(comparison.states) + 1]
        ratio = NO_VALUE if mean.model == comparison.names[0] else _ratio(mean, with_intervals)
        if not with_intervals:
            return [*(format_number(row.rms, 3) for row in errors), ratio]
        return [*(_cell(*np.sqrt([row.mse, row.mse_low, row.mse_high])) for row in errors), ratio]

    states = [Column(each.symbol, each.unit) for each in comparison.states]
    note = _ratio_note(comparison)
    return _library_table(
        comparison,
        f"RMS error over {_steps(comparison)} steps",
        [*states, Column("MSE", "ratio")],
        comparison.names,
        cells,
        [f"{note} In brackets: {INTERVAL}" if with_intervals else note],
    )


def ratio_table(comparison: Comparison) -> Table:
    """Mean squared errors of all others over those of the reference."""
    reference, best = comparison.names[0], comparison.best_linear(comparison.parts[0].name)
    others = [name for name in comparison.library if name != reference]
    fair = f"{FAIR_LTI}: for each state the better of {' and '.join(LTI_BASELINES)}."
    notes = [fair] if FAIR_LTI in others else []
    notes += [f"Best linear baseline in the geometric mean: {best}."] if best else []
    units = (f"{len(comparison.states)} states", f"without {PROGRESS}")
    means = [Column("geometric mean", unit) for unit in units[: len(mean_names(comparison.states))]]
    return _library_table(
        comparison,
        f"MSE of each model over MSE of {reference}; above 1, {reference} is better",
        [*(Column(each.symbol) for each in comparison.states), *means],
        others,
        lambda rows: [
            _cell(row.over_reference, row.over_reference_low, row.over_reference_high)
            for row in rows
        ],
        notes,
    )


def parts_table(comparison: Comparison, parts: Sequence[Part]) -> Table:
    """On each part: the best linear baseline and other models over the reference."""
    reference, *others = comparison.models
    columns = [Column("part", is_text=True)]
    if comparison.linear:
        columns += [Column("best linear", is_text=True), Column("MSE ratio")]
    columns += [*(Column(name, "MSE ratio") for name in others), Column("own MSE", "ratio")]
    lines, n = list[Row](), len(comparison.states)
    for part in parts:
        cells = [part.name]
        if best := comparison.best_linear(part.name):
            cells += [best, _ratio(comparison.table[part.name, best][n])]
        cells += [_ratio(comparison.table[part.name, name][n], False) for name in others]
        own = comparison.table[part.name, reference][n]
        lines.append((*cells, format_number(own.over_library, 3)))
    notes = (
        f"{_ratio_note(comparison)} In brackets: {INTERVAL}",
        f"Own MSE ratio: MSE of {reference} over its own on the library, geometric mean.",
    )
    return Table(f"Errors of {reference} on each part", tuple(columns), tuple(lines), notes)


def _ratio_note(comparison: Comparison) -> str:
    first = comparison.names[0]
    return f"MSE ratio: MSE over that of {first}, geometric mean over the states."


def _library_table(
    comparison: Comparison,
    title: str,
    columns: Iterable[Column],
    names: Iterable[str],
    cells_of: Callable[[Sequence[Errors]], Sequence[Cell | str]],
    notes: Sequence[str],
) -> Table:
    """A line for each of these models, made of its rows on the library."""
    heads = (Column("model", is_text=True), *columns)
    found = comparison.library
    # Cells beyond the heads are those of the geometric means.
    lines = tuple((name, *cells_of(found[name])[: len(heads) - 1]) for name in names)
    late = [f"Not converged within the time of a fit: {', '.join(comparison.not_converged)}."]
    notes = [*notes, *(late if comparison.not_converged else [])]
    return Table(f"{title} on {comparison.parts[0].size}", heads, lines, tuple(notes))


def _steps(comparison: Comparison) -> int:
    """K, the length of the horizon."""
    return len(next(iter(comparison.by_step.values())).value)


def _cell(value: float, low: float, high: float) -> Cell:
    """A number, with its interval in a second line."""
    return Cell(format_number(value), _interval(low, high))


def _ratio(row: Errors, with_interval: bool = True) -> str:
    """A ratio to the reference, with its interval in brackets."""
    interval = with_interval and _interval(row.over_reference_low, row.over_reference_high)
    return format_number(row.over_reference, 3) + (f" ({interval})" if interval else "")


def _interval(low: float, high: float) -> str:
    has_interval = low <= high < float("inf")
    return f"{format_number(low, 3)}{NO_VALUE}{format_number(high, 3)}" if has_interval else ""
