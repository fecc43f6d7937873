"""The sentence and the tables of an evaluation, for the terminal, the model card and the page.

They are views of `Comparison.table`. The title of each table says what is compared with what, on
which trajectories.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from offline.evaluation.bootstrap import CONFIDENCE, RESAMPLES, Estimate
from offline.evaluation.comparison import FAIR_LTI, LTI_BASELINES, Comparison
from offline.evaluation.metrics import PROGRESS, mean_names
from offline.evaluation.parts import Part
from rt_controller.report.table import NO_VALUE, Cell, Column, Row, Table, format_number

INTERVAL = f"{100 * CONFIDENCE:g} % interval, bootstrap by episode, {RESAMPLES} resamples."
NO_INTERVALS = "Without intervals: they need several episodes."
_FIRST = {"ey": "lateral position", "vx": "speed"}
"""states of the first sentence, in its words; of data without them the first two"""


def headline(comparison: Comparison) -> str:
    """How far each model and the best linear baseline are off at the end of the horizon."""
    library = comparison.parts[0]
    places = {state.name: i for i, state in enumerate(comparison.states)}
    words = {name: text for name, text in _FIRST.items() if name in places}
    words = words or {name: name for name in [*places][:2]}

    def errors(model: str) -> str:
        at_end = comparison.by_step[model].value[-1]
        texts = (
            f"{format_number(at_end[places[name]], 2)} {comparison.states[places[name]].unit} in "
            f"{text}"
            for name, text in words.items()
        )
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
    """Mean squared errors on the library with intervals. Paper: Table I."""
    found = {name: comparison.library[name] for name in comparison.names}
    diverged = ", ".join(f"{name} on {r[0].diverged}" for name, r in found.items() if r[0].diverged)
    note = f"Second line: {INTERVAL}" if comparison.parts[0].n_episodes > 1 else NO_INTERVALS
    if diverged:
        note = f"No finite prediction: {diverged} trajectories."
    return _table(
        f"MSE over {_steps(comparison)} steps of each model on {comparison.parts[0].size}",
        ["model", *(Column(each.name, each.squared_unit) for each in comparison.states)],
        {
            name: [_cell(row.mse) for row in rows[: len(comparison.states)]]
            for name, rows in found.items()
        },
        [note, *_not_converged(comparison)],
    )


def rms_table(comparison: Comparison, with_intervals: bool = False) -> Table:
    """Root mean square errors on the library, and their ratio to the reference's, squared.

    `with_intervals`: of the errors; otherwise only the ratio has one.
    """
    n, reference = len(comparison.states), comparison.reference
    rows: dict[str, Sequence[Cell | str]] = {}
    for name in comparison.names:
        of_model = comparison.library[name]
        cells = [_cell(row.rms) for row in of_model[:n]]
        rows[name] = [*(cells if with_intervals else (cell.text for cell in cells))]
        rows[name] += [NO_VALUE if name == reference else _inline(of_model[n].over_reference)]
    return _table(
        f"RMS error over {_steps(comparison)} steps of each model on {comparison.parts[0].size}",
        [
            "model",
            *(Column(each.name, each.unit) for each in comparison.states),
            Column("MSE over that of", reference),
        ],
        rows,
        [
            f"Last column: geometric mean over the states, in brackets {INTERVAL}",
            *_not_converged(comparison),
        ],
    )


def ratio_table(comparison: Comparison) -> Table:
    """Mean squared errors of all others over those of the reference."""
    reference = comparison.reference
    others = {name: rows for name, rows in comparison.library.items() if name != reference}
    best = comparison.best_linear(comparison.parts[0].name)
    notes = [f"Best linear baseline in the geometric mean: {best}."] if best else []
    if FAIR_LTI in others:
        notes.insert(0, f"{FAIR_LTI}: for each state the better of {' and '.join(LTI_BASELINES)}.")
    return _table(
        f"MSE of each model over MSE of {reference} on {comparison.parts[0].size}: above 1, "
        f"{reference} is better",
        [
            "model",
            *(Column(each.name) for each in comparison.states),
            *_mean_heads(comparison, "geometric mean"),
        ],
        {name: [_cell(row.over_reference) for row in rows] for name, rows in others.items()},
        notes + _not_converged(comparison),
    )


def parts_table(comparison: Comparison, parts: Sequence[Part]) -> Table:
    """On each part: the best linear baseline and other models over the reference."""
    reference, n = comparison.reference, len(comparison.states)
    columns = [Column("part", is_text=True), Column("trajec-", "tories")]
    if comparison.linear:
        columns += [Column("best linear", is_text=True), Column("its MSE", "ratio")]
        columns.append(Column("smallest", "of a state"))
    columns += [Column(name, "MSE ratio") for name in comparison.models[1:]]
    columns.append(Column("over the", "library"))
    rows = list[Row]()
    for part in parts:
        cells = [part.name, f"{part.n_trajectories}"]
        if best := comparison.best_linear(part.name):
            of_best = comparison.table[part.name, best]
            smallest = min(
                of_best[:n], key=lambda row: np.nan_to_num(row.over_reference.value, nan=np.inf)
            )
            ratio = format_number(smallest.over_reference.value, 3)
            cells += [best, _inline(of_best[n].over_reference), f"{ratio} {smallest.state}"]
        for name in comparison.models[1:]:
            cells.append(_inline(comparison.table[part.name, name][n].over_reference))
        own = comparison.table[part.name, reference][n].over_library
        rows.append((*cells, format_number(own.value, 3)))
    title = f"MSE over that of {reference} on each part, and its own over that on the library"
    return Table(f"{title}; geometric means over the states", tuple(columns), tuple(rows))


def _steps(comparison: Comparison) -> int:
    """K, the length of the horizon."""
    return len(next(iter(comparison.by_step.values())).value)


def _cell(found: Estimate) -> Cell:
    """A number, with its interval in a second line."""
    return Cell(format_number(found.value), _interval(found))


def _inline(found: Estimate) -> str:
    """The same in one line."""
    interval = _interval(found)
    return format_number(found.value, 3) + (f" ({interval})" if interval else "")


def _interval(found: Estimate) -> str:
    if not found.low <= found.high < float("inf"):
        return ""
    return f"{format_number(found.low, 3)}{NO_VALUE}{format_number(found.high, 3)}"


def _table(
    title: str,
    heads: Iterable[Column | str],
    rows: Mapping[str, Sequence[Cell | str]],
    notes: Sequence[str] = (),
) -> Table:
    """A table whose rows have a name; a head without a unit is text: that of the names."""
    columns = tuple(Column(each, is_text=True) if isinstance(each, str) else each for each in heads)
    return Table(title, columns, tuple((name, *row) for name, row in rows.items()), (*notes,))


def _mean_heads(comparison: Comparison, title: str) -> list[Column]:
    units = (f"{len(comparison.states)} states", f"without {PROGRESS}")
    return [
        Column(title, unit) for _, unit in zip(mean_names(comparison.states), units, strict=False)
    ]


def _not_converged(comparison: Comparison) -> list[str]:
    """A footnote if a baseline could have been trained for longer."""
    names = ", ".join(comparison.not_converged)
    return [f"Not converged within the time of a fit: {names}."] if names else []
