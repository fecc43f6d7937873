"""The sentence and the tables of an evaluation, for the terminal, the model card and the page.

They are views of `Comparison.figures`. The title of each table says what is compared with what, on
which trajectories.
"""

from collections.abc import Iterable, Mapping, Sequence

from offline.evaluation.bootstrap import CONFIDENCE, RESAMPLES
from offline.evaluation.comparison import FAIR_LTI, LINEAR, LTI_BASELINES, Comparison
from offline.evaluation.metrics import MEANS, PROGRESS, Figures
from offline.evaluation.test_sets import LIBRARY, TestSet
from rt_controller.report.table import NO_VALUE, Cell, Column, Row, Table, format_number

INTERVALS = (
    f"Second line: {100 * CONFIDENCE:g} % interval, bootstrap by episode, {RESAMPLES} resamples."
)
NO_INTERVALS = "Without intervals: they need several episodes."
_FIRST = {"ey": "lateral position", "vx": "speed"}
"""states of the first sentence, in its words; of data without them the first two"""


def headline(comparison: Comparison) -> str:
    """How far each model and the best linear baseline are off at the end of the horizon."""
    by_step, library = comparison.library["by_step"], comparison.sets[0]
    columns = {column.name: column for column in comparison.columns}
    words = {name: text for name, text in _FIRST.items() if name in columns}
    words = words or {name: name for name in [*columns][:2]}

    def errors(model: str) -> str:
        rms = by_step[model]["rms"]
        ends = {name: rms[columns[name].key]["value"][-1] for name in words}
        texts = (
            f"{format_number(ends[name], 2)} {columns[name].unit} in {words[name]}"
            for name in words
        )
        return " and ".join(texts)

    first, *others = comparison.models
    text = (
        f"From one measurement and the inputs, {first} predicts the next "
        f"{comparison.dt_s * comparison.steps:g} s of a drive; at their end it is off by "
        f"{errors(first)}, root mean square over {library.n_trajectories} trajectories."
    )
    text += "".join(f" {name} is off by {errors(name)}." for name in others)
    best = comparison.library["best_baseline"].get(LINEAR)
    return text + (f" The best linear model, {best}, is off by {errors(best)}." if best else "")


def comparison_tables(comparison: Comparison) -> list[Table]:
    """The tables in the order in which `offline-evaluate` prints them; the page has them too."""
    library = comparison.sets[0]
    tables = [mse_table(comparison, library), rms_table(comparison, library)]
    for model in comparison.models:
        if comparison.baselines:
            tables.append(ratio_table(comparison, model, library))
        tables.append(conditions_table(comparison, model))
    return tables


def mse_table(comparison: Comparison, test: TestSet) -> Table:
    """Mean squared errors with intervals. Paper: Table I."""
    models = comparison.figures["sets"][test.name]["models"]
    counts = {n: each["trajectories_without_finite_prediction"] for n, each in models.items()}
    diverged = ", ".join(f"{name} on {count}" for name, count in counts.items() if count)
    note = INTERVALS if test.n_episodes > 1 else NO_INTERVALS
    if diverged:
        note = f"No finite prediction: {diverged} trajectories."
    return _table(
        f"MSE over {comparison.steps} steps of each model on {test.size}",
        ["model", *_squared(comparison)],
        {name: interval_cells(each["mse"].values()) for name, each in models.items()},
        [note, *_not_converged(comparison)],
    )


def rms_table(comparison: Comparison, test: TestSet, with_intervals: bool = False) -> Table:
    """Root mean square errors."""
    models = comparison.figures["sets"][test.name]["models"]
    to_cells = interval_cells if with_intervals else _values
    return _table(
        f"RMS error over {comparison.steps} steps of each model on {test.size}",
        ["model", *_states(comparison)],
        {name: to_cells(each["rms"].values()) for name, each in models.items()},
    )


def ratio_table(comparison: Comparison, model: str, test: TestSet) -> Table:
    """Mean errors of each baseline over those of the model."""
    found = comparison.figures["sets"][test.name]
    ratios = found["baseline_mse_over_model_mse"][model]
    note = f"{FAIR_LTI}: for each state the better of {' and '.join(LTI_BASELINES)}."
    notes = [note] if FAIR_LTI in ratios else []
    if LINEAR in found["best_baseline"]:
        best = found["best_baseline"][LINEAR]
        notes.append(f"Best linear baseline in the geometric mean: {best}.")
    title = f"MSE of each baseline over MSE of {model} on {test.size}: above 1, {model} is better"
    return _ratio_table(title, "baseline", comparison, ratios, notes + _not_converged(comparison))


def conditions_table(comparison: Comparison, model: str) -> Table:
    """Each slice of each series: the best linear baseline over the model, the model over itself."""
    means, rows, has_linear = _mean_heads(comparison), list[Row](), bool(comparison.baselines)
    for series in comparison.figures["series"].values():
        unit = f", {series['unit']}" if series["unit"] else ""
        sets = {part["set"] for part in series["slices"]}
        of_set = f", {sets.pop()}" if len(sets) == 1 else ""
        rows.append((f"{series['quantity']}{unit}{of_set}",))
        for part in series["slices"]:
            cells = [part["label"], f"{part['n_trajectories']}"]
            if best := part["best_baseline"].get(LINEAR):
                ratios = part["baseline_mse_over_model_mse"][model][best]
                state = part["state_of_smallest_ratio"][model][best]
                smallest = Cell(format_number(ratios[state]["value"]), state)
                cells += [best, *interval_cells(means_of(ratios)), smallest]
            elif has_linear:
                cells += [NO_VALUE] * (2 + len(means))
            growth = part["mse_over_library_mse"][model]
            rows.append((*cells, *interval_cells(means_of(growth))))
    columns = [Column("part", is_text=True), Column("trajectories")]
    compared = f"MSE of {model} over its own on the whole {LIBRARY}"
    if has_linear:
        compared = f"MSE of the best linear baseline over that of {model}, and {compared}"
        columns.append(Column("best linear", is_text=True, width="short"))
        columns += [head._replace(title="MSE ratio") for head in means]
        columns.append(Column("smallest", "of a state"))
    columns += [head._replace(title=f"over {LIBRARY}") for head in means]
    return Table(f"{compared}; geometric means over the states", tuple(columns), tuple(rows))


def means_of(ratios: Figures) -> list[Figures]:
    """The geometric means that there are."""
    return [ratios[name] for name in MEANS if name in ratios]


def interval_cells(estimates: Iterable[Figures]) -> list[Cell]:
    """The numbers of estimates with their intervals."""
    cells = []
    for value, low, high in (each.values() for each in estimates):
        has_interval = low <= high < float("inf")
        interval = f"{format_number(low, 3)}{NO_VALUE}{format_number(high, 3)}"
        cells.append(Cell(format_number(value), interval if has_interval else ""))
    return cells


def _ratio_table(
    title: str, first: str, comparison: Comparison, ratios: Figures, notes: Sequence[str]
) -> Table:
    states = (Column(each.name) for each in comparison.columns)
    rows = {name: interval_cells(each.values()) for name, each in ratios.items()}
    return _table(title, [first, *states, *_mean_heads(comparison)], rows, notes)


def _table(
    title: str,
    heads: Sequence[Column | str],
    rows: Mapping[str, Sequence[Cell | str]],
    notes: Sequence[str] = (),
) -> Table:
    """A table whose rows have a name; a head without a unit is text: that of the names."""
    columns = tuple(Column(each, is_text=True) if isinstance(each, str) else each for each in heads)
    return Table(title, columns, tuple((name, *row) for name, row in rows.items()), (*notes,))


def _states(comparison: Comparison) -> list[Column]:
    return [Column(each.name, each.unit) for each in comparison.columns]


def _squared(comparison: Comparison) -> list[Column]:
    return [Column(each.name, each.squared_unit) for each in comparison.columns]


def _mean_heads(comparison: Comparison) -> list[Column]:
    """Heads of the geometric means."""
    names = [column.name for column in comparison.columns]
    has_progress = PROGRESS in names and len(names) > 1
    units = (f"{len(names)} states", *([f"without {PROGRESS}"] if has_progress else []))
    return [Column("geometric mean", unit) for unit in units]


def _values(estimates: Iterable[Figures]) -> list[str]:
    return [format_number(each["value"]) for each in estimates]


def _not_converged(comparison: Comparison) -> list[str]:
    """A footnote if a baseline could have been trained for longer."""
    names = ", ".join(comparison.not_converged)
    return [f"Not converged within the time of a fit: {names}."] if names else []
