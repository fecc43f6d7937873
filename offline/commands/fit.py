"""`offline-fit`: a car file for the simulated car from the data set of recorded drives."""

import json
from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from pydantic import Field

from offline.commands.options import LATEST_RUN, JsonFile
from offline.commands.terminal import STDERR, STDOUT, print_plain, quoted
from rt_controller.contract.errors import ConfigError, require_packages
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.contract.limits import DEFAULT_GEOMETRY
from rt_controller.terminal.command_line import new_app, run_command
from sim_bridge.plant.shipped_cars import DEFAULT_CAR, shipped_cars

if TYPE_CHECKING:
    from offline.data.dataset import Dataset
    from offline.evaluation.car_fit import CarFit, MeasuredDrive
    from rt_controller.contract.limits import SteeringGeometry
    from rt_controller.report.table import Table
    from sim_bridge.plant.parameters import Parameters

FAR_OFF_YAW_PERCENT, FAR_OFF_SPEED_PERCENT = 5.0, 3.0
"""errors of a car whose tyres or drive are not those of the logs"""

app = new_app(
    "offline-fit",
    "Fit the parameters of the simulated car that the drives of an imported data set can tell, and "
    "write a car file. The drives held back for validation and test judge it. docs/own-car.md has "
    "the parameters.",
    "DATA FITTED",
)
main = partial(run_command, app)


@app.default
def fit(
    data: Path,
    fitted: Path,
    *,
    car: str = DEFAULT_CAR,
    mass_kg: Annotated[float, Field(gt=100.0, lt=50_000.0)] | None = None,
    only: Annotated[tuple[str, ...], Parameter(negative=(), show_default=False)] = (),
    windows: Annotated[int, Field(ge=6, le=2000)] = 40,
    plot: Path | None = None,
    json_file: JsonFile = None,
) -> None:
    """Write a car file that differs from another car by what the drives tell.

    Args:
        data: folder of the data set that offline-import made
        fitted: car file that is written
        car: name or file of the car to begin with; what is not told stays as it is there
        mass_kg: mass of the car of the logs, which they do not tell; default: that of --car
        only: name of a parameter to fit; may be given several times; default: all
        windows: most windows of 5 s that are used; more take longer and tell more
        plot: write a picture of the held-out drives, measured and simulated, to this file
    """
    require_packages("offline", ("torch",), "offline-fit")
    for file, option in ((json_file, "--json"), (fitted, "FITTED"), (plot, "--plot")):
        suffix = ".toml" if file is fitted else ""
        require_writable(file, option, suffix=suffix, inputs=(car,))
    if plot is not None:
        from rt_controller.report.drive_figure import require_figure_file

        require_figure_file(plot, moves=False)
    from offline.data.dataset import load_dataset
    from offline.evaluation.car_fit import drives_of, fit_car, judge
    from offline.evaluation.car_parameters import fitted_of, with_stated
    from rt_controller.contract.files import write_text
    from rt_controller.report.table import Fact, facts_table, print_table
    from sim_bridge.plant.parameters import car_table, load_parameters

    dataset, named = load_dataset(data), load_parameters(car)
    if named.tyre_file.fnomin != 0.0:
        raise ConfigError(f"--car {car}: expected a car without tyre_file, which is not fitted.")
    base = with_stated(named, mass_kg, _known_geometry(dataset))
    parameters = fitted_of(base)
    names = [each.name for each in parameters]
    unknown = [name for name in only if name not in names]
    if unknown:
        raise ConfigError(
            f"--only: expected names out of {', '.join(names)}, found {', '.join(unknown)}."
        )
    parameters = tuple(each for each in parameters if not only or each.name in only)
    held_out = drives_of(dataset, ("validation", "test"))
    with STDERR.status("judging") as status:
        before = judge(base, held_out)
        result = fit_car(base, parameters, drives_of(dataset, ("train",)), windows, status.update)
        status.update("judging")
        after = judge(result.car, held_out)
    print_table(values_table(result), STDOUT)
    judged = (
        "yaw rate, RMS error over RMS",
        "lateral speed, RMS error over RMS",
        "speed within 10 s, RMS error over range",
    )
    rows = [
        Fact(name, f"{new:.2f} %, before the fit {old:.2f} %")
        for name, new, old in zip(judged, after[:3], before[:3], strict=True)
        if isfinite(new)
    ]
    print_table(facts_table(rows, f"held-out drives, {after.judged_s:.0f} s"), STDOUT)
    source = f"fitted by offline-fit to {data.resolve().name}, SHA-256 {dataset.sha256:.16}"
    stated = with_source(car_table(car), named, base, "stated to offline-fit: mass or axles")
    write_text(fitted, to_toml(with_source(stated, base, result.car, source)))
    if plot is not None:
        draw(result.car, held_out, plot)
    write_figures(
        json_file,
        {
            "car_file": str(fitted),
            "windows": result.windows,
            "parameters": {name: each._asdict() for name, each in result.values.items()},
            "held_out": after._asdict(),
            "held_out_before": before._asdict(),
        },
    )
    if after.speed_error_percent > FAR_OFF_SPEED_PERCENT:
        others = [f"--car {each}" for each in shipped_cars() if each != car]
        print_plain(
            f"note: the speed is far off. A car with another engine or motor may fit better: "
            f"{', '.join(others)}."
        )
    if after.yaw_rate_error_percent > FAR_OFF_YAW_PERCENT:
        print_plain(
            "note: the yaw rate is far off. Check wheelbase_m and rear_axle_m in [car] of the "
            "mapping, and leave out drives at the limit of friction: the shape of the tyre "
            "curve is not fitted."
        )
    bundle = LATEST_RUN / "bundle"
    model = f" --model {bundle}" if bundle.is_dir() else ""
    print_plain(
        f"{fitted}\nNext, a drive on this car:\n"
        f"  rt-controller --bus virtual --car {quoted(fitted)}{model}\n"
        f"Then the bus or a log of the real car, with a mapping for driving (docs/own-car.md):\n"
        f"  rt-controller signals check MAPPING LOG"
    )


def _known_geometry(dataset: "Dataset") -> "SteeringGeometry | None":
    """That of [car] in the mapping; None if it says nothing about it."""
    geometry, default = dataset.manifest.geometry, DEFAULT_GEOMETRY
    if geometry is None or geometry.wheelbase_m == default.wheelbase_m:
        return None  # its rear axle may be one that offline-import has estimated
    return geometry


def values_table(result: "CarFit") -> "Table":
    """One row for each number."""
    from rt_controller.report.table import Column, Table, format_number

    columns = (
        Column("parameter", is_text=True),
        Column("before"),
        Column("fitted"),
        Column("± (95 %)"),
    )
    rows = tuple(
        (
            name,
            format_number(each.base),
            format_number(each.value),
            each.remark or format_number(0.5 * (each.high - each.low), 2),
        )
        for name, each in result.values.items()
    )
    notes = (
        f"{result.windows} windows of the training drives. The unit ends the name; without one "
        f"the number is dimensionless. What these logs do not tell stays as before.",
    )
    return Table("fitted car", columns, rows, notes)


def with_source(
    file: dict[str, Any], before: "Parameters", after: "Parameters", source: str
) -> dict[str, Any]:
    """The content of a car file with the values of `after` that differ from `before`."""
    changed = dict(file)
    for part in before._fields:
        old, new = getattr(before, part), getattr(after, part)
        for name, value in new._asdict().items():
            if value != getattr(old, name):
                entry = {"value": value, "source": source}
                changed[part] = {**changed.get(part, {}), name: entry}
    return changed


def to_toml(file: dict[str, Any]) -> str:
    """The text of a car file with this content."""
    tables = {name: entry for name, entry in file.items() if isinstance(entry, dict)}
    lines = [f"{name} = {json.dumps(entry)}" for name, entry in file.items() if name not in tables]
    for part, entries in tables.items():
        lines += ["", f"[{part}]"]
        lines += [
            f"{name} = {{ value = {json.dumps(entry['value'])}, "
            f"source = {json.dumps(entry['source'], ensure_ascii=False)} }}"
            for name, entry in entries.items()
        ]
    return "\n".join(lines) + "\n"


def draw(car: "Parameters", drives: "list[MeasuredDrive]", file: Path) -> None:
    """A picture of at most 12 held-out windows, measured and simulated, each from its own start."""
    import numpy as np

    from offline.evaluation.car_fit import JUDGE_S, simulated, windows_of
    from rt_controller.report.canvas import FAINT, add_legend, empty_figure

    windows = windows_of(car, drives, JUDGE_S, 12)
    figure, axes = empty_figure(3, 1, 8.0, sharex=True)
    factors = 3.6, 1.0, np.degrees(1.0)
    for k, window in enumerate(windows):
        drive = window.drive
        time_s = JUDGE_S * k + drive.period_s * np.arange(window.end - window.begin)
        measured = drive.measured[window.begin : window.end]
        names = ("", "") if k else ("measured", "simulated")
        pairs = zip(axes, measured.T, simulated(car, window).T, factors, strict=True)
        for axis, real, ours, factor in pairs:
            axis.plot(time_s, factor * real, color=FAINT, lw=4.0, label=names[0])
            axis.plot(time_s, factor * ours, color="#2f6fb3", lw=1.0, label=names[1])
    for axis, text in zip(axes, ("v_x / km/h", "v_y / m/s", "yaw rate / deg/s"), strict=True):
        axis.set_ylabel(text)
    axes[-1].set_xlabel(f"windows of {JUDGE_S:g} s, one after the other / s")
    add_legend(figure, axes[0])
    figure.savefig(file)
