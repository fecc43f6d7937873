"""`python -m benchmarks.false_alarms`: how often a car without a fault is stopped.

Every scenario is driven in simulated time with friction 0.5 to 1, mass -15 % to +15 %, grades,
bank, side wind, all shipped cars, steps of the wanted speed and of the path, and the noise and
offsets of production sensors, a quarter of the drives without them. Half of the drives end in a
stop that is requested at any time of the scenario. A drive in which a check fails is driven again
without checks: if the car leaves its path there too, it has too little grip and the stop is right;
else the alarm is a false one.
"""

import json
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import cyclopts
from rich.console import Console
from threadpoolctl import threadpool_limits

from benchmarks.false_alarms.conditions import Condition, conditions
from benchmarks.false_alarms.drive import DriveResult, measure, result_from
from benchmarks.false_alarms.summary import driven_h, json_of, table_of
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.model.artifact import SHIPPED_MODEL
from rt_controller.model.bundle import Bundle
from rt_controller.report.table import to_markdown
from sim_bridge.scenario import shipped_scenarios

app = cyclopts.App(name="python -m benchmarks.false_alarms", version_flags=[])


@app.default
def main(
    *,
    model: str | None = None,
    scenarios: tuple[str, ...] = (),
    hours: float = 10.0,
    jobs: int = 1,
    drives: Path | None = None,
    json: Annotated[Path | None, cyclopts.Parameter(name="--json")] = None,
) -> None:
    """Drive until so many hours are reached, and print the rate of false alarms of each check.

    Args:
        model: name of a shipped model, or folder of a bundle.
        scenarios: names; default: all that are shipped.
        hours: of simulated driving.
        jobs: processes.
        drives: file with one line of JSON for each drive. What it already has is not driven again:
            an interrupted run goes on with the same command.
        json: also write the figures there.
    """
    require_writable(json)
    require_writable(drives, "--drives")
    found = _earlier(drives, model)
    done = {each.condition for each in found}
    names = scenarios or shipped_scenarios()
    todo = (each for each in conditions(names) if each not in done)
    hours_left = hours - driven_h(found)
    for each in _drive_all(todo, model, max(jobs, 1), 3600.0 * hours_left):
        found.append(each)
        _append(drives, model, each)
        print(f"{driven_h(found):.3f} h {each.condition} {each.failed_checks}", flush=True)
    if found:
        report(found, json, model)


def report(found: Sequence[DriveResult], json_file: Path | None, model: str | None) -> None:
    """Print the figures and the false alarms, and write the file."""
    console = Console()
    console.print(to_markdown(table_of(found)))
    false = [each for each in found if each.false_checks]
    console.print(f"{len(false)} of {len(found)} drives with a false alarm", highlight=False)
    for each in false:
        print(f"{each.condition}: {each.false_checks}, |e_y| {each.ey_peak_m:.2f} m")
    hashes = {model or SHIPPED_MODEL: Bundle.load(model).sha256}
    write_figures(json_file, {"model_sha256": hashes, **json_of(found)})


def _drive_all(
    todo: Iterator[Condition], model: str | None, jobs: int, seconds: float
) -> Iterator[DriveResult]:
    """Drives in order until so many seconds of driving are reached."""
    drive = partial(measure, model=model)
    if jobs == 1:
        with threadpool_limits(1, "blas"):
            while seconds > 0.0:
                found = drive(next(todo))
                seconds -= found.driven_s
                yield found
        return
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        while seconds > 0.0:
            for found in pool.map(drive, islice(todo, 4 * jobs)):
                seconds -= found.driven_s
                yield found


def _earlier(path: Path | None, model: str | None) -> list[DriveResult]:
    """The drives of an interrupted run.

    Raises:
        ConfigError: they are of another model.
    """
    if path is None or not path.exists():
        return []
    lines: list[dict[str, Any]] = [json.loads(line) for line in path.read_text().splitlines()]
    own = _name(model)
    others = {line["model"] for line in lines} - {own}
    if others:
        raise ConfigError(
            f"--drives {path}: expected drives of the model {own}, found {', '.join(others)}. Name "
            f"another file, or the same model."
        )
    return [result_from(line["drive"]) for line in lines]


def _append(path: Path | None, model: str | None, found: DriveResult) -> None:
    if path is not None:
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"model": _name(model), "drive": found.figures()}) + "\n")


def _name(model: str | None) -> str:
    return Bundle.load(model).sha256[:16]


if __name__ == "__main__":
    app()
